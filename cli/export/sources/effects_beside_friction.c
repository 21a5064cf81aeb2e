/* Effects that change friction, or add friction to that of a law; see effects.h. Source:
 * twin/effects/. */
#include <math.h>

#include "effects.h"

static const double kPi = 3.14159265358979323846;
static const double kContact_m = 1e-6; /* travel that renews the contacts */

void servotwin_friction_map(const double* shape, EffectMemory* memory, const Motion* m,
                            double* force) {
  (void)memory;
  for (int j = 0; j < 4; ++j) force[j] = tanh(shape[j] * m->velocity + shape[4 + j]);
  force[4] = 1.0;
}

void servotwin_asymmetric_friction(const double* shape, EffectMemory* memory, const Motion* m,
                                   double* force) {
  (void)shape;
  (void)memory;
  force[0] = fabs(servotwin_direction(m));
  force[1] = fabs(m->velocity);
}

void servotwin_falling_friction(const double* shape, EffectMemory* memory, const Motion* m,
                                double* force) {
  const double speed = fabs(m->velocity);
  (void)memory;
  force[0] = servotwin_direction(m);
  if (speed > 0.0) force[0] *= exp(-pow(speed / shape[0], shape[1]));
}

void servotwin_position_dependent_friction(const double* shape, EffectMemory* memory,
                                           const Motion* m, double* force) {
  const double direction = servotwin_direction(m);
  const double angle = 2.0 * kPi * m->position / shape[0];
  (void)memory;
  force[0] = direction * m->position;
  force[1] = force[0] * m->position;
  force[2] = direction * sin(angle);
  force[3] = direction * cos(angle);
}

void servotwin_added_friction(const double* shape, EffectMemory* memory, const Motion* m,
                              double* force) {
  const double on = servotwin_onset(m->time_s, shape[0]);
  (void)memory;
  force[0] = on * servotwin_direction(m);
  force[1] = on * m->velocity;
}

void servotwin_dwell_stiction(const double* shape, EffectMemory* memory, const Motion* m,
                              double* force) {
  const double by_way = fabs(m->displacement), by_speed = fabs(m->velocity) * m->step_s;
  const double moved = by_speed < by_way ? by_speed : by_way;
  const double before = memory->rest.age_s;
  memory->rest.age_s = (before + m->step_s) * exp(-moved / kContact_m);
  if (memory->rest.age_s > before)
    memory->rest.extra += log((shape[1] + memory->rest.age_s) / (shape[1] + before));
  memory->rest.extra *= exp(-moved / shape[0]);
  force[0] = memory->rest.extra * servotwin_direction(m);
}

void servotwin_viscous_drift(const double* shape, EffectMemory* memory, const Motion* m,
                             double* force) {
  (void)memory;
  force[0] = exp(-m->time_s / shape[0]) * m->velocity;
}
