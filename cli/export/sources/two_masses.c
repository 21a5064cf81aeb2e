/* See two_masses.h. */
#include "two_masses.h"

#include <math.h>
#include <string.h>

#include "axis_forces.h"

enum { kError, kRate, kDeflection, kDeflectionRate, kIntegral };
enum { kAtMotor, kAtLoad, kOutside }; /* AxisMasses.encoders */

static const double kSmallestTurn = 1e-11, kLargestMiss = 1e-13; /* as in twin/two_mass_step.cpp */
enum { kMostTurns = 12 };

/* The motion of both masses at the end of a part. */
typedef struct {
  double motor_position, motor_velocity, motor_acceleration;
  double load_position, load_velocity, load_acceleration;
  double loop_error, loop_rate, demand, demand_rate;
  double recorded_error;
} Ends;

/* A part of a cycle that is being solved. */
typedef struct {
  const AxisModel* model;
  AxisState* state; /* with the forces that are tried */
  const CommandPiece* piece;
  double free[kMassStates]; /* its end without the forces there */
  Motion motor, load;
} Part;

static void with_forces(const AxisMasses* two, const double* free, double motor, double load,
                        double* out) {
  for (int r = 0; r < two->states; ++r)
    out[r] = free[r] + (two->motor_end[r] * motor + two->load_end[r] * load);
}

static Ends ends_of(const AxisModel* model, const double* state, const CommandPiece* piece,
                    double motor_force, double load_force) {
  const AxisMasses* two = &model->masses;
  const int integrates = two->states == kMassStates;
  Ends out;
  out.motor_position = piece->end_position - state[kError];
  out.motor_velocity = piece->end_velocity - state[kRate];
  out.load_position = out.motor_position - state[kDeflection];
  out.load_velocity = out.motor_velocity - state[kDeflectionRate];
  out.loop_error = state[kError] + (two->encoders == kAtLoad ? state[kDeflection] : 0.0);
  out.loop_rate = state[kRate];
  out.recorded_error = state[kError] + (two->encoders == kAtMotor ? 0.0 : state[kDeflection]);
  out.demand = two->command_acceleration * piece->end_acceleration +
               two->command_velocity * piece->end_velocity + two->a1 * state[kRate] +
               two->by_motor * state[kError] + two->by_loop * (state[kError] + state[kDeflection]) +
               (integrates ? state[kIntegral] : 0.0);
  out.demand_rate = model->integral * out.loop_error -
                    model->integral_velocity * piece->end_velocity; /* 0 without an integrator */
  const double contact =
      two->load_share * two->omega *
      (two->omega * state[kDeflection] + 2.0 * two->zeta * state[kDeflectionRate]);
  out.motor_acceleration = (out.demand - contact - motor_force) / (1.0 - two->load_share);
  out.load_acceleration = (contact - load_force) / two->load_share;
  return out;
}

/* The force by which the spring falls short of the linear one. */
static double missing_contact(const AxisMasses* two, const double* state) {
  const double half = 0.5 * two->width, scale = two->load_share * two->omega;
  const double deflection = state[kDeflection], rate = state[kDeflectionRate];
  const double held = deflection < -half ? -half : deflection > half ? half : deflection;
  const double linear = scale * (two->omega * deflection + 2.0 * two->zeta * rate);
  const double beyond = deflection - held;
  if (half == 0.0) return 0.0;
  if (beyond == 0.0) return linear;
  const double contact = scale * (two->omega * beyond + 2.0 * two->zeta * rate);
  if (beyond > 0.0) return linear - (contact > 0.0 ? contact : 0.0);
  return linear - (contact < 0.0 ? contact : 0.0);
}

/* The motion of a body at the end of a part with the forces as they are tried. */
static void set_motion(Part* part, Body body, Motion* m) {
  const AxisModel* model = part->model;
  const AxisState* s = part->state;
  const double motor_force = s->force - s->contact, load_force = s->load_force + s->contact;
  double state[kMassStates] = {0};
  with_forces(&model->masses, part->free, motor_force, load_force, state);
  const Ends now = ends_of(model, state, part->piece, motor_force, load_force);
  m->position = body == kLoad ? now.load_position : now.motor_position;
  m->velocity = body == kLoad ? now.load_velocity : now.motor_velocity;
  m->acceleration = body == kLoad ? now.load_acceleration : now.motor_acceleration;
  m->displacement = m->position - (body == kLoad ? s->load_position : s->motor_position);
  m->tracking_error = now.loop_error;
  m->demand = now.demand;
  m->demand_rate = now.demand_rate;
  m->demand_damping = model->damping * now.loop_rate;
}

static double miss_of_contact(void* of, double trial) {
  Part* part = of;
  const AxisMasses* two = &part->model->masses;
  AxisState* s = part->state;
  double state[kMassStates] = {0};
  s->contact = trial;
  with_forces(two, part->free, s->force - trial, s->load_force + trial, state);
  return trial - missing_contact(two, state);
}

static double miss_of_load(void* of, double trial) {
  Part* part = of;
  part->state->load_force = trial;
  set_motion(part, kLoad, &part->load);
  return trial - servotwin_disturbance(part->model, part->state, &part->load, kLoad);
}

static double miss_of_motor(void* of, double trial) {
  Part* part = of;
  part->state->force = trial;
  set_motion(part, kMotor, &part->motor);
  return trial - servotwin_disturbance(part->model, part->state, &part->motor, kMotor);
}

static void balance_contact(Part* part) {
  AxisState* s = part->state;
  if (part->model->masses.width > 0.0)
    s->contact = servotwin_balanced(s->contact, &s->contact_slope, miss_of_contact, part);
}

static void miss_of_both(void* of, double motor, double load, double out[2]) {
  Part* part = of;
  part->state->force = motor;
  part->state->load_force = load;
  balance_contact(part);
  set_motion(part, kMotor, &part->motor);
  set_motion(part, kLoad, &part->load);
  out[0] = motor - servotwin_disturbance(part->model, part->state, &part->motor, kMotor);
  out[1] = load - servotwin_disturbance(part->model, part->state, &part->load, kLoad);
}

static void hold_apart(AxisState* s) {
  s->together[0][0] = s->together[1][1] = 1.0;
  s->together[0][1] = s->together[1][0] = 0.0;
}

/* Solves the forces on motor and load and that of the play: together, or else in turns. */
static void balance(Part* part) {
  AxisState* s = part->state;
  const int couples = part->model->masses.width > 0.0 || servotwin_acts_on(part->model, kMotor);
  if (couples) {
    const double force = s->force, load_force = s->load_force, contact = s->contact;
    if (servotwin_balanced_pair(force, load_force, s->together, kLargestMiss, miss_of_both, part))
      return;
    hold_apart(s);
    s->force = force;
    s->load_force = load_force;
    s->contact = contact;
  }
  for (int turn = 0; turn < kMostTurns; ++turn) {
    const double motor_before = s->force, contact_before = s->contact;
    balance_contact(part);
    s->load_force = servotwin_balanced(s->load_force, &s->load_slope, miss_of_load, part);
    s->force = servotwin_balanced(s->force, &s->slope, miss_of_motor, part);
    if (!couples) break;
    if (fabs(s->force - motor_before) <= kSmallestTurn &&
        fabs(s->contact - contact_before) <= kSmallestTurn)
      break;
  }
}

/* The state in which the forces are balanced, with the load on the side to which they push. */
static void set_at_rest(const AxisMasses* two, AxisState* s) {
  const int integrates = two->states == kMassStates;
  const double stiffness = two->load_share * two->omega * two->omega;
  const double held = s->force + s->load_force;
  const double loop_error = integrates ? 0.0 : held / two->a2;
  memset(s->masses, 0, sizeof s->masses);
  s->masses[kDeflection] = s->load_force / stiffness;
  if (two->width > 0.0 && s->load_force != 0.0)
    s->masses[kDeflection] += (s->load_force > 0.0 ? 0.5 : -0.5) * two->width;
  s->masses[kError] = loop_error - (two->encoders == kAtLoad ? s->masses[kDeflection] : 0.0);
  if (integrates) s->masses[kIntegral] = held - two->by_motor * s->masses[kError];
}

void servotwin_start_two_masses(const AxisModel* model, AxisState* s, double command) {
  Motion rest;
  CommandPiece still;
  memset(&rest, 0, sizeof rest);
  memset(&still, 0, sizeof still);
  still.end_position = command;
  rest.step_s = model->cycle_s / model->parts;
  rest.time_s = s->time_s;
  s->load_slope = s->contact_slope = 1.0;
  hold_apart(s);
  for (int turn = 0; turn < kMostTurns; ++turn) {
    const double motor_before = s->force, load_before = s->load_force;
    set_at_rest(&model->masses, s);
    s->contact = missing_contact(&model->masses, s->masses);
    const Ends now =
        ends_of(model, s->masses, &still, s->force - s->contact, s->load_force + s->contact);
    s->motor_position = now.motor_position;
    s->load_position = now.load_position;
    s->position = command - now.recorded_error;
    s->demand = now.demand;
    for (int body = kMotor; body <= (int)kLoad; ++body) {
      rest.position = body == kLoad ? s->load_position : s->motor_position;
      rest.tracking_error = now.loop_error;
      rest.demand = now.demand;
      *(body == kLoad ? &s->load_force : &s->force) =
          servotwin_disturbance(model, s, &rest, (Body)body);
    }
    if (fabs(s->force - motor_before) <= kSmallestTurn &&
        fabs(s->load_force - load_before) <= kSmallestTurn)
      break;
  }
  servotwin_remember(model, s, kMotor);
  servotwin_remember(model, s, kLoad);
  rest.position = s->position;
  s->reading = servotwin_reading(model, s, &rest);
}

double servotwin_advance_two_masses(const AxisModel* model, AxisState* s,
                                    const CommandPiece* piece) {
  const AxisMasses* two = &model->masses;
  const double motor_before = s->force, load_before = s->load_force;
  Part part;
  memset(&part, 0, sizeof part);
  part.model = model;
  part.state = s;
  part.piece = piece;
  for (int r = 0; r < two->states; ++r) {
    double sum = two->command[r][0] * piece->velocity + two->command[r][1] * piece->acceleration +
                 two->command[r][2] * piece->jerk + two->motor_begin[r] * (s->force - s->contact) +
                 two->load_begin[r] * (s->load_force + s->contact);
    for (int c = 0; c < two->states; ++c) sum += two->phi[r][c] * s->masses[c];
    part.free[r] = sum;
  }
  s->time_s += model->cycle_s / model->parts;
  part.motor.step_s = model->cycle_s / model->parts;
  part.motor.time_s = s->time_s;
  part.motor.command_velocity = piece->end_velocity;
  part.motor.command_acceleration = piece->end_acceleration;
  part.motor.neighbour_acceleration = piece->neighbour_acceleration;
  part.motor.in_cut = piece->in_cut;
  part.load = part.motor;
  s->force += s->force_change;
  s->load_force += s->load_force_change;
  balance(&part);
  servotwin_remember(model, s, kMotor);
  servotwin_remember(model, s, kLoad);
  const double motor_force = s->force - s->contact, load_force = s->load_force + s->contact;
  with_forces(two, part.free, motor_force, load_force, s->masses);
  const Ends now = ends_of(model, s->masses, piece, motor_force, load_force);
  s->force_change = s->force - motor_before;
  s->load_force_change = s->load_force - load_before;
  s->motor_position = now.motor_position;
  s->load_position = now.load_position;
  s->demand = now.demand;
  s->position = two->encoders == kAtMotor ? now.motor_position : now.load_position;
  s->velocity = two->encoders == kAtMotor ? now.motor_velocity : now.load_velocity;
  s->reading = servotwin_reading(model, s, two->encoders == kAtMotor ? &part.motor : &part.load);
  return now.recorded_error - s->reading;
}
