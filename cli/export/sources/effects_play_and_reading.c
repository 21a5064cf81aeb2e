/* Play, and effects that only the reading shows; see effects.h. Source: twin/effects/,
 * twin/effects/load_in_gap.h. */
#include <math.h>

#include "effects.h"

static const double kPi = 3.14159265358979323846;

/* A load behind a gap, over one cycle. */
static void follow(const double* shape, EffectMemory* memory, const Motion* m) {
  if (!memory->gap.under_way) memory->gap.load = m->velocity;
  memory->gap.under_way = 1;
  const double half = 0.5 * shape[0], slows = m->step_s * shape[2];
  double slower = memory->gap.load / (1.0 + slows / shape[1]);
  if (slower > shape[1]) slower = memory->gap.load - slows;
  if (slower < -shape[1]) slower = memory->gap.load + slows;
  double apart_rate = m->velocity - slower;
  const double apart = m->displacement - 0.5 * m->step_s * (memory->gap.load + slower);
  memory->gap.play += apart;
  const double beyond = fabs(memory->gap.play) - half;
  if (beyond > 0.0) {
    const double left = 1.0 - beyond / (fabs(apart) + 1e-15);
    apart_rate = left > 0.0 ? apart_rate * left : 0.0;
    memory->gap.play = memory->gap.play > 0.0 ? half : -half;
  }
  memory->gap.alone = apart_rate;
  memory->gap.load = m->velocity - memory->gap.alone;
}

void servotwin_backlash(const double* shape, EffectMemory* memory, const Motion* m, double* force) {
  follow(shape, memory, m);
  force[0] = -memory->gap.play;
  force[1] = 1.0;
}

void servotwin_backlash_behind_encoder(const double* shape, EffectMemory* memory, const Motion* m,
                                       double* force) {
  const double before = memory->gap.alone;
  follow(shape, memory, m);
  force[0] =
      servotwin_saturated(memory->gap.load, shape[1]) - servotwin_saturated(m->velocity, shape[1]);
  force[1] = -(memory->gap.alone - before) / m->step_s;
}

void servotwin_backlash_in_loop(const double* shape, EffectMemory* memory, const Motion* m,
                                double* force) {
  const double half = 0.5 * shape[0];
  const double before = memory->value;
  memory->value += m->command_velocity * m->step_s;
  if (memory->value > half) memory->value = half;
  if (memory->value < -half) memory->value = -half;
  force[0] = (memory->value - before) / m->step_s;
}

void servotwin_lead_error(const double* shape, EffectMemory* memory, const Motion* m,
                          double* force) {
  const double angle = 2.0 * kPi * m->position / shape[0];
  (void)memory;
  force[0] = m->position;
  force[1] = sin(angle);
  force[2] = cos(angle);
  force[3] = 1.0;
}

void servotwin_thermal_growth(const double* shape, EffectMemory* memory, const Motion* m,
                              double* force) {
  const double warm = 1.0 - exp(-m->time_s / shape[0]);
  (void)memory;
  force[0] = warm * m->position;
  force[1] = warm;
  force[2] = 1.0;
}
