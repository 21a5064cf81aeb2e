/* The effects of the catalogue in C: a translation of twin/effects/, line by line.
 *
 * tests/cli/export/translation_test.cpp runs both along the same motions and compares them
 * (docs/decisions/0009). Units, meanings, sources and bounds are in twin/effects/ only.
 * Any thread; no allocation. */
#ifndef SERVOTWIN_EFFECTS_H
#define SERVOTWIN_EFFECTS_H

#include <stddef.h>

enum {
  kMaxShapes = 8,
  kMaxCoefficients = 9,
  kElements = 10,
  kFreeElements = 8, /* of gms */
  kSlipElements = 6  /* of maxwell_slip */
};

/* The motion of one axis at one sample: twin/effect.h. */
typedef struct {
  double step_s;
  double position, velocity, displacement, acceleration;
  double command_velocity, command_acceleration;
  double tracking_error;
  double time_s;
  double neighbour_acceleration;
  double in_cut;
  double demand;
  double friction; /* NaN where no law is known */
  double demand_rate, demand_damping;
} Motion;

/* A state that follows an input with two poles. */
typedef struct {
  double q, rate;
} Swing;

/* A Maxwell-slip element whose level changes with velocity. */
typedef struct {
  double force;
  int sliding; /* +1, -1: direction it slides in; 0: it sticks */
} AttractedElement;

/* The memory of one effect from cycle to cycle. */
typedef union {
  struct {
    double stiffness[kElements], level[kElements], force[kElements];
  } springs; /* presliding, smoothed_presliding, maxwell_slip */
  struct {
    double stiffness[kElements], level[kElements];
    AttractedElement element[kElements];
  } attracted; /* presliding_stribeck, gms */
  struct {
    double play, load, alone;
    int under_way;
  } gap; /* backlash, backlash_behind_encoder */
  struct {
    Swing by_command, by_friction;
  } mode; /* compliance */
  struct {
    Swing by_command, by_friction;
    double velocity, direction;
    int under_way;
  } filter;    /* control_filter */
  Swing other; /* cross_coupling */
  struct {
    double age_s, extra;
  } rest; /* dwell_stiction */
  struct {
    double held, asked, rate;
  } limit;      /* torque_saturation, torque_saturation_holding */
  double value; /* dahl, lugre, backlash_in_loop, gain_change, torque_saturation_back_calculation */
} EffectMemory;

/* The quantity that an effect acts on. */
typedef enum { kActsAsFriction, kActsAsForce, kActsOnReading, kDelaysCommand } Acts;

/* The body of two masses on which a force acts: twin/two_mass_axis.h. */
typedef enum { kOnLoad, kOnMotor, kOnBoth } ActsOn;

typedef struct {
  const char* id;
  Acts acts;
  ActsOn body;
  int shapes, coefficients;
  size_t memory; /* bytes of EffectMemory that it uses; all 0 at the start */
  /* Computes what depends on the shapes only; NULL: nothing. */
  void (*start)(const double* shape, EffectMemory* memory);
  /* Forces per unit coefficient at one sample. */
  void (*unit_forces)(const double* shape, EffectMemory* memory, const Motion* m, double* force);
  /* Of a law of friction: Motion.friction from its unit forces; NULL: the first of them. */
  double (*friction)(const double* coefficient, const double* force);
} EffectKind;

/* All effects; the number of them in `count`. */
const EffectKind* servotwin_effects(int* count);
/* The index of the effect with this id, or -1. */
int servotwin_find_effect(const char* id);

/* Shared by the files of effects. */
double servotwin_direction(const Motion* m);
double servotwin_saturated(double velocity, double limit);

/* effects_friction.c */
void servotwin_coulomb_friction(const double*, EffectMemory*, const Motion*, double*);
void servotwin_presliding_start(const double*, EffectMemory*);
void servotwin_presliding(const double*, EffectMemory*, const Motion*, double*);
void servotwin_smoothed_presliding(const double*, EffectMemory*, const Motion*, double*);
void servotwin_gms_start(const double*, EffectMemory*);
void servotwin_gms(const double*, EffectMemory*, const Motion*, double*);
double servotwin_gms_friction(const double*, const double*);
void servotwin_maxwell_slip_start(const double*, EffectMemory*);
void servotwin_maxwell_slip(const double*, EffectMemory*, const Motion*, double*);
double servotwin_maxwell_slip_friction(const double*, const double*);
void servotwin_lugre(const double*, EffectMemory*, const Motion*, double*);
void servotwin_dahl(const double*, EffectMemory*, const Motion*, double*);
void servotwin_stribeck(const double*, EffectMemory*, const Motion*, double*);
double servotwin_stribeck_friction(const double*, const double*);
void servotwin_modified_stribeck(const double*, EffectMemory*, const Motion*, double*);
void servotwin_presliding_stribeck_start(const double*, EffectMemory*);
void servotwin_presliding_stribeck(const double*, EffectMemory*, const Motion*, double*);

/* effects_beside_friction.c: effects that change friction, or add friction to that of a law */
void servotwin_friction_map(const double*, EffectMemory*, const Motion*, double*);
void servotwin_asymmetric_friction(const double*, EffectMemory*, const Motion*, double*);
void servotwin_falling_friction(const double*, EffectMemory*, const Motion*, double*);
void servotwin_position_dependent_friction(const double*, EffectMemory*, const Motion*, double*);
void servotwin_added_friction(const double*, EffectMemory*, const Motion*, double*);
void servotwin_dwell_stiction(const double*, EffectMemory*, const Motion*, double*);
void servotwin_viscous_drift(const double*, EffectMemory*, const Motion*, double*);

/* effects_force.c: forces other than friction */
void servotwin_constant_force(const double*, EffectMemory*, const Motion*, double*);
void servotwin_feedforward_mismatch(const double*, EffectMemory*, const Motion*, double*);
void servotwin_cogging(const double*, EffectMemory*, const Motion*, double*);
void servotwin_swinging_load(const double*, EffectMemory*, const Motion*, double*);
void servotwin_compliance(const double*, EffectMemory*, const Motion*, double*);
void servotwin_control_filter(const double*, EffectMemory*, const Motion*, double*);
void servotwin_cross_coupling(const double*, EffectMemory*, const Motion*, double*);
void servotwin_cross_coupling_by_motion(const double*, EffectMemory*, const Motion*, double*);
void servotwin_cutting_force(const double*, EffectMemory*, const Motion*, double*);
void servotwin_encoder_error(const double*, EffectMemory*, const Motion*, double*);
void servotwin_gain_change(const double*, EffectMemory*, const Motion*, double*);
void servotwin_impulse_disturbance(const double*, EffectMemory*, const Motion*, double*);
void servotwin_inertia_change(const double*, EffectMemory*, const Motion*, double*);
void servotwin_periodic_disturbance(const double*, EffectMemory*, const Motion*, double*);
void servotwin_torque_saturation(const double*, EffectMemory*, const Motion*, double*);
void servotwin_torque_saturation_holding(const double*, EffectMemory*, const Motion*, double*);
void servotwin_torque_saturation_back_calculation(const double*, EffectMemory*, const Motion*,
                                                  double*);
void servotwin_unexplained_over_position(const double*, EffectMemory*, const Motion*, double*);
void servotwin_unexplained_over_velocity(const double*, EffectMemory*, const Motion*, double*);
void servotwin_unexplained_over_acceleration(const double*, EffectMemory*, const Motion*, double*);

/* effects_play_and_reading.c: play, and effects that only the reading shows */
void servotwin_backlash(const double*, EffectMemory*, const Motion*, double*);
void servotwin_backlash_behind_encoder(const double*, EffectMemory*, const Motion*, double*);
void servotwin_backlash_in_loop(const double*, EffectMemory*, const Motion*, double*);
void servotwin_lead_error(const double*, EffectMemory*, const Motion*, double*);
void servotwin_thermal_growth(const double*, EffectMemory*, const Motion*, double*);

/* Shared by all effects that begin at one moment. */
double servotwin_onset(double time_s, double at_s);

#endif
