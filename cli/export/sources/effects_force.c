/* Forces other than friction; see effects.h. Source: twin/effects/, twin/effects/swing.h. */
#include <math.h>

#include "effects.h"

static const double kPi = 3.14159265358979323846;

void servotwin_constant_force(const double* shape, EffectMemory* memory, const Motion* m,
                              double* force) {
  (void)shape;
  (void)memory;
  (void)m;
  force[0] = 1.0;
}

void servotwin_feedforward_mismatch(const double* shape, EffectMemory* memory, const Motion* m,
                                    double* force) {
  (void)shape;
  (void)memory;
  force[0] = -m->command_velocity;
  force[1] = -m->command_acceleration;
}

void servotwin_cogging(const double* shape, EffectMemory* memory, const Motion* m, double* force) {
  const double angle = 2.0 * kPi * m->position / shape[0];
  (void)memory;
  force[0] = sin(angle);
  force[1] = cos(angle);
  force[2] = sin(2.0 * angle);
  force[3] = cos(2.0 * angle);
}

void servotwin_swinging_load(const double* shape, EffectMemory* memory, const Motion* m,
                             double* force) {
  (void)shape;
  (void)memory;
  force[0] = sin(m->position);
  force[1] = cos(m->position);
}

/* Exact steps of q'' + 2 zeta w q' + w^2 q = w^2 rest, at any damping. */
typedef struct {
  double w, zeta, cosine, sine; /* both faded; sine over the damped frequency */
} SwingStep;

static SwingStep swing_step(double frequency_hz, double damping_ratio, double step_s) {
  const double nearly_critical = 1e-4;
  SwingStep s;
  double turned, faded;
  s.w = 2.0 * kPi * frequency_hz;
  s.zeta = damping_ratio;
  turned = s.w * s.w * (1.0 - s.zeta * s.zeta) * step_s * step_s;
  faded = s.zeta * s.w * step_s;
  if (turned > nearly_critical) {
    const double angle = sqrt(turned);
    s.cosine = exp(-faded) * cos(angle);
    s.sine = exp(-faded) * sin(angle) / angle * step_s;
  } else if (turned < -nearly_critical) {
    const double apart = sqrt(-turned), slow = exp(apart - faded), fast = exp(-apart - faded);
    s.cosine = 0.5 * (slow + fast);
    s.sine = 0.5 * (slow - fast) / apart * step_s;
  } else {
    s.cosine = exp(-faded) * (1.0 - turned / 2.0 * (1.0 - turned / 12.0));
    s.sine = exp(-faded) * (1.0 - turned / 6.0 * (1.0 - turned / 20.0)) * step_s;
  }
  return s;
}

static void advance(const SwingStep* s, Swing* swing, double rest) {
  const double q = swing->q - rest, drag = s->zeta * s->w;
  swing->q = rest + q * s->cosine + (swing->rate + drag * q) * s->sine;
  swing->rate = swing->rate * s->cosine - (s->w * s->w * q + drag * swing->rate) * s->sine;
}

void servotwin_compliance(const double* shape, EffectMemory* memory, const Motion* m,
                          double* force) {
  const SwingStep mode = swing_step(shape[0], shape[1], m->step_s);
  const double direction = servotwin_direction(m);
  advance(&mode, &memory->mode.by_command, -m->command_acceleration / (mode.w * mode.w));
  advance(&mode, &memory->mode.by_friction, -direction);
  force[0] = mode.w * memory->mode.by_command.q;
  force[1] = memory->mode.by_command.rate;
  force[2] = memory->mode.by_friction.q + direction;
  force[3] = memory->mode.by_friction.rate / mode.w;
}

void servotwin_control_filter(const double* shape, EffectMemory* memory, const Motion* m,
                              double* force) {
  const SwingStep poles = swing_step(shape[0], shape[1], m->step_s);
  const double direction = servotwin_direction(m);
  const double acceleration = memory->filter.under_way
                                  ? (m->command_velocity - memory->filter.velocity) / m->step_s
                                  : m->command_acceleration;
  advance(&poles, &memory->filter.by_command, -acceleration / (poles.w * poles.w));
  advance(&poles, &memory->filter.by_friction, -0.5 * (memory->filter.direction + direction));
  memory->filter.velocity = m->command_velocity;
  memory->filter.direction = direction;
  memory->filter.under_way = 1;
  force[0] = poles.w * memory->filter.by_command.q;
  force[1] = memory->filter.by_command.rate;
  force[2] = memory->filter.by_friction.q + direction;
  force[3] = memory->filter.by_friction.rate / poles.w;
}

void servotwin_cross_coupling(const double* shape, EffectMemory* memory, const Motion* m,
                              double* force) {
  const SwingStep loop = swing_step(shape[0], shape[1], m->step_s);
  advance(&loop, &memory->other, m->neighbour_acceleration);
  force[0] = memory->other.q;
  force[1] = memory->other.rate / loop.w;
  force[2] = m->neighbour_acceleration - memory->other.q;
}

void servotwin_cross_coupling_by_motion(const double* shape, EffectMemory* memory, const Motion* m,
                                        double* force) {
  (void)shape;
  (void)memory;
  force[0] = m->neighbour_acceleration;
}

void servotwin_cutting_force(const double* shape, EffectMemory* memory, const Motion* m,
                             double* force) {
  const double angle = 2.0 * kPi * shape[0] * m->time_s;
  (void)memory;
  force[0] = m->in_cut;
  force[1] = m->in_cut * sin(angle);
  force[2] = m->in_cut * cos(angle);
}

void servotwin_encoder_error(const double* shape, EffectMemory* memory, const Motion* m,
                             double* force) {
  const double k = 2.0 * kPi / shape[0];
  const double s = sin(k * m->position), c = cos(k * m->position);
  const double turning = k * m->velocity * (k * m->velocity);
  const double speeding = k * m->command_acceleration;
  (void)memory;
  force[0] = turning * s - speeding * c;
  force[1] = turning * c + speeding * s;
}

void servotwin_gain_change(const double* shape, EffectMemory* memory, const Motion* m,
                           double* force) {
  const double on = servotwin_onset(m->time_s, shape[0]);
  force[0] = on * m->tracking_error;
  memory->value += on * (m->tracking_error * m->step_s);
  force[1] = memory->value;
}

void servotwin_impulse_disturbance(const double* shape, EffectMemory* memory, const Motion* m,
                                   double* force) {
  (void)memory;
  for (int i = 0; i < 4; ++i) {
    const double u = (m->time_s - shape[i]) / shape[4];
    force[i] = u > -1.0 && u < 1.0 ? 0.5 * (1.0 + cos(kPi * u)) : 0.0;
  }
}

void servotwin_inertia_change(const double* shape, EffectMemory* memory, const Motion* m,
                              double* force) {
  (void)memory;
  force[0] = servotwin_onset(m->time_s, shape[0]) * m->acceleration;
}

void servotwin_periodic_disturbance(const double* shape, EffectMemory* memory, const Motion* m,
                                    double* force) {
  const double angle = 2.0 * kPi * shape[0] * m->time_s;
  (void)memory;
  force[0] = sin(angle);
  force[1] = cos(angle);
}

static double beyond(double limit, double asked) {
  if (asked > limit) return asked - limit;
  return asked < -limit ? asked + limit : 0.0;
}

/* The change of what the integrator is held by over this step: twin/effects/torque_saturation.h. */
static double change_of_held(const double* shape, EffectMemory* memory, const Motion* m,
                             double asked, int clamps) {
  const double last = memory->limit.asked;
  const int was_beyond = last > shape[0] || last < -shape[0];
  const double side = (was_beyond ? last : asked) > 0.0 ? 1.0 : -1.0;
  const double before = side * last - shape[0];
  const double now = side * asked - shape[0];
  const double rate = m->demand_rate + shape[1] * m->demand_damping;
  const double leads = 0.5 * side * (rate + memory->limit.rate);
  const double all = m->step_s * leads;
  const double now_if_held = now - all;
  double change = 0.0;
  memory->limit.rate = rate;
  if (clamps && !(leads > 0.0)) return 0.0;
  if (before > 0.0) {
    change = now_if_held > 0.0 ? all : all * before / (before - now_if_held);
    if (!(now_if_held > 0.0) && now > change) change = now;
  } else if (now > 0.0) {
    change = all * now / (now - before);
    if (change > now) change = now;
  }
  return side * change;
}

static void stops_at_limit(const double* shape, EffectMemory* memory, const Motion* m,
                           double* force, int clamps) {
  const double without = m->demand + shape[2] * m->velocity;
  double asked;
  memory->limit.held += change_of_held(shape, memory, m, without - memory->limit.held, clamps);
  asked = without - memory->limit.held;
  memory->limit.asked = asked;
  force[0] = beyond(shape[0], asked) + memory->limit.held;
}

void servotwin_torque_saturation(const double* shape, EffectMemory* memory, const Motion* m,
                                 double* force) {
  stops_at_limit(shape, memory, m, force, 1);
}

void servotwin_torque_saturation_holding(const double* shape, EffectMemory* memory, const Motion* m,
                                         double* force) {
  stops_at_limit(shape, memory, m, force, 0);
}

void servotwin_torque_saturation_back_calculation(const double* shape, EffectMemory* memory,
                                                  const Motion* m, double* force) {
  const double without = m->demand + shape[2] * m->velocity;
  if (m->demand_rate != 0.0)
    memory->value += beyond(shape[0], without - memory->value) * (1.0 - exp(-m->step_s / shape[1]));
  force[0] = beyond(shape[0], without - memory->value) + memory->value;
}

static void over(double at, const double* shape, double* force) {
  const double last = 8.0;
  double u = last * (at - shape[0]) / (shape[1] - shape[0]);
  if (u < 0.0) u = 0.0;
  if (u > last) u = last;
  for (int i = 0; i < 9; ++i) {
    const double away = u - (double)i;
    const double near = away < 0.0 ? 1.0 + away : 1.0 - away;
    force[i] = near > 0.0 ? near : 0.0;
  }
}

void servotwin_unexplained_over_position(const double* shape, EffectMemory* memory, const Motion* m,
                                         double* force) {
  (void)memory;
  over(m->position, shape, force);
}

void servotwin_unexplained_over_velocity(const double* shape, EffectMemory* memory, const Motion* m,
                                         double* force) {
  (void)memory;
  over(m->velocity, shape, force);
}

void servotwin_unexplained_over_acceleration(const double* shape, EffectMemory* memory,
                                             const Motion* m, double* force) {
  (void)memory;
  over(m->command_acceleration, shape, force);
}
