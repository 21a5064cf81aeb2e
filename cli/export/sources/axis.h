/* The twin of one axis in C: a translation of twin/twin.cpp, with given matrices of its steps.
 *
 * Both structs are plain data without pointers: a copy saves a state, which can be restored. Any
 * thread, one at a time for one state; no allocation. Metres or radians, seconds, forces per moved
 * mass. tests/cli/export/translation_test.cpp compares it with twin/twin.cpp
 * (docs/decisions/0009). */
#ifndef SERVOTWIN_AXIS_H
#define SERVOTWIN_AXIS_H

#include "effects.h"

enum { kMaxOrder = 3, kMaxModes = 6, kMaxStates = 2 * kMaxOrder + 2 * kMaxModes };
enum { kMaxEffects = 16, kHistory = 512, kMaxDelayCycles = 500, kMassStates = 5 };

typedef struct {
  int kind; /* place in servotwin_effects() */
  double shape[kMaxShapes], coefficient[kMaxCoefficients];
} AxisEffect;

/* The step of a state over one part of a cycle, and its share in the error: twin/twin.h,
 * StepConstants. */
typedef struct {
  int first, width; /* of its block */
  double phi[kMaxOrder], command[3], force_begin, force_end;
  double rest;                /* of a constant unit disturbance held at rest */
  double error, rate, second; /* its part of the error and of its derivatives */
} AxisRow;

/* The constants with which a part of a cycle is computed. */
typedef struct {
  AxisRow row[kMaxStates];
  /* The error's derivatives directly by the command's velocity and acceleration and by the force;
   */
  double rate_velocity, second_velocity, second_acceleration, second_force;
  /* error, rate and second derivative by the force at the end, through the states. */
  double error_force_end, rate_force_end, second_force_end;
} AxisStep;

/* A mode of vibration and how it moves with position: twin/loop.h, Mode. */
typedef struct {
  double omega, zeta, alpha, beta, gamma, delta, slope, curve, zeta_slope;
} AxisMode;

/* Motor and load as two masses: twin/two_mass_axis.h. */
typedef struct {
  int states;   /* 5 with integral action, else 4; 0: the axis is one body */
  int encoders; /* Encoders of twin/effects/two_mass.h: at the motor, at the load, outside */
  double omega, zeta, load_share, friction_share, width;
  double a1, a2, by_loop, by_motor; /* by_loop + by_motor = a2 */
  double command_velocity, command_acceleration;
  double phi[kMassStates][kMassStates], command[kMassStates][3];
  double motor_begin[kMassStates], motor_end[kMassStates];
  double load_begin[kMassStates], load_end[kMassStates];
} AxisMasses;

/* The parameters of a model. */
typedef struct {
  int order;  /* 2 or 3 */
  int parts;  /* number of parts in which a cycle is solved */
  int states; /* 2 order, and 2 for every mode of vibration */
  double cycle_s;
  double damping, integral, integral_velocity; /* a1, a3, c2 of order 3, else 0 */
  AxisStep step; /* of every part, without the share of moving modes */
  /* If a mode moves: all modes, the loop without them, and the ends of the travel. */
  int modes; /* 0: none moves */
  double denominator[kMaxOrder], numerator[kMaxOrder], travel[2];
  AxisMode mode[kMaxModes];
  AxisMasses masses;
  int effects;
  AxisEffect effect[kMaxEffects]; /* in any order */
} AxisModel;

/* The state, which changes from cycle to cycle. */
typedef struct {
  double linear[kMaxStates];
  EffectMemory memory[kMaxEffects], trial[kMaxEffects];
  double force, force_change, slope;
  /* Of two masses, of which the above is the motor's: the load, and the force that the spring
   * misses in the play. */
  EffectMemory load_memory[kMaxEffects], load_trial[kMaxEffects];
  double masses[kMassStates];
  double load_force, load_force_change, load_slope, contact, contact_slope;
  double together[2][2]; /* the inverse of the slopes of both forces */
  double motor_position, load_position;
  double demand, position, velocity, reading;
  double neighbour_acceleration;
  double time_s;
  double history[kHistory];
  int newest;
} AxisState;

/* The commanded motion in one cycle: at its start, as a cubic over the cycle, and at its end. */
typedef struct {
  double velocity, acceleration, jerk;
  double end_position, end_velocity, end_acceleration;
  double neighbour_acceleration;
  double in_cut;
} CommandPiece;

/* Puts the axis at rest at this command. */
void servotwin_start(const AxisModel* model, AxisState* state, double command, double time_s);
/* One cycle from commands alone: the cubic goes through the last four (delayed) ones. The command,
 * the neighbour's acceleration and `in_cut` are those of its end. Returns the tracking error at the
 * end. */
double servotwin_follow(const AxisModel* model, AxisState* state, double command,
                        double neighbour_acceleration, double in_cut);
/* One cycle along a known motion, for a model whose command is not delayed. */
double servotwin_step(const AxisModel* model, AxisState* state, const CommandPiece* piece);
/* The modes' part of a step over which the command is `over` and at whose end it is `at_end`. */
void servotwin_place_modes(const AxisModel* model, double over, double at_end, AxisStep* step);
/* The sum of all command delays [s]. */
double servotwin_delay_s(const AxisModel* model);

#endif
