/* See axis_forces.h. */
#include "axis_forces.h"

#include <math.h>
#include <string.h>

static const EffectKind* kind_of(const AxisEffect* effect) {
  int count = 0;
  return &servotwin_effects(&count)[effect->kind];
}

static int is_force(const EffectKind* kind) {
  return kind->acts == kActsAsFriction || kind->acts == kActsAsForce;
}

/* The share of a force that acts on this body; below 0: the force does not act there. */
static double share_on(const AxisModel* model, const EffectKind* kind, Body body) {
  const double on_load = model->masses.friction_share;
  const int both = kind->body == kOnBoth && on_load != 1.0;
  if (model->masses.states == 0) return body == kMotor ? 1.0 : -1.0;
  if (both) return body == kMotor ? 1.0 - on_load : on_load;
  return (body == kMotor) == (kind->body == kOnMotor) ? 1.0 : -1.0;
}

static EffectMemory* memories_of(AxisState* state, Body body) {
  return body == kMotor ? state->memory : state->load_memory;
}

static EffectMemory* trials_of(AxisState* state, Body body) {
  return body == kMotor ? state->trial : state->load_trial;
}

void servotwin_start_memories(const AxisModel* model, AxisState* state) {
  for (int i = 0; i < model->effects; ++i) {
    const EffectKind* kind = kind_of(&model->effect[i]);
    if (kind->start == NULL) continue;
    kind->start(model->effect[i].shape, &state->memory[i]);
    kind->start(model->effect[i].shape, &state->load_memory[i]);
  }
}

int servotwin_acts_on(const AxisModel* model, Body body) {
  for (int i = 0; i < model->effects; ++i) {
    const EffectKind* kind = kind_of(&model->effect[i]);
    if (is_force(kind) && share_on(model, kind, body) >= 0.0) return 1;
  }
  return 0;
}

double servotwin_disturbance(const AxisModel* model, AxisState* state, Motion* m, Body body) {
  double force[kMaxCoefficients], coefficient[kMaxCoefficients];
  double sum = 0.0;
  m->friction = NAN;
  for (int acts = kActsAsFriction; acts <= (int)kActsAsForce; ++acts) {
    for (int i = 0; i < model->effects; ++i) {
      const AxisEffect* effect = &model->effect[i];
      const EffectKind* kind = kind_of(effect);
      const double share = share_on(model, kind, body);
      EffectMemory* trial = &trials_of(state, body)[i];
      if ((int)kind->acts != acts || share < 0.0) continue;
      memcpy(trial, &memories_of(state, body)[i], kind->memory);
      kind->unit_forces(effect->shape, trial, m, force);
      for (int k = 0; k < kind->coefficients; ++k) {
        coefficient[k] = effect->coefficient[k] * share;
        sum += coefficient[k] * force[k];
      }
      if (kind->acts == kActsAsFriction)
        m->friction = kind->friction != NULL ? kind->friction(coefficient, force) : force[0];
    }
  }
  return sum;
}

void servotwin_remember(const AxisModel* model, AxisState* state, Body body) {
  for (int i = 0; i < model->effects; ++i) {
    const EffectKind* kind = kind_of(&model->effect[i]);
    if (is_force(kind) && share_on(model, kind, body) >= 0.0)
      memcpy(&memories_of(state, body)[i], &trials_of(state, body)[i], kind->memory);
  }
}

double servotwin_reading(const AxisModel* model, AxisState* state, const Motion* m) {
  double unit[kMaxCoefficients];
  double sum = 0.0;
  for (int i = 0; i < model->effects; ++i) {
    const AxisEffect* effect = &model->effect[i];
    const EffectKind* kind = kind_of(effect);
    if (kind->acts != kActsOnReading) continue;
    kind->unit_forces(effect->shape, &state->memory[i], m, unit);
    for (int k = 0; k < kind->coefficients; ++k) sum += effect->coefficient[k] * unit[k];
  }
  return sum;
}

static const double kLeast = 0.2, kMost = 1e6; /* accepted slopes of a secant */

double servotwin_balanced(double first, double* slope, double (*miss)(void* of, double trial),
                          void* of) {
  const double tolerance = 1e-15 + 1e-13 * fabs(first);
  double left = first, miss_left = miss(of, left);
  if (fabs(miss_left) <= tolerance) return left;
  for (int round = 0; round < 5; ++round) {
    const double next = left - miss_left / *slope, miss_next = miss(of, next);
    if (fabs(miss_next) <= tolerance) return next;
    const double now = (miss_next - miss_left) / (next - left);
    left = next;
    miss_left = miss_next;
    if (!(now > kLeast && now < kMost)) break;
    *slope = now;
  }
  double right = left, miss_right = miss_left, reach = 1.0;
  while ((miss_right > 0.0) == (miss_left > 0.0) && reach < 1e12) {
    right = left - reach * miss_left;
    miss_right = miss(of, right);
    if (miss_right == 0.0) break;
    reach *= 2.0;
  }
  for (int round = 1; round <= 100 && fabs(miss_right) > tolerance; ++round) {
    const double low = right < left ? right : left, high = right < left ? left : right;
    double next = (left * miss_right - right * miss_left) / (miss_right - miss_left);
    if (round % 8 == 0 || !(next > low && next < high)) next = 0.5 * (left + right);
    if (next == left || next == right) break;
    const double miss_next = miss(of, next);
    if ((miss_next > 0.0) == (miss_right > 0.0)) {
      miss_left *= 0.5;
    } else {
      left = right;
      miss_left = miss_right;
    }
    right = next;
    miss_right = miss_next;
  }
  return right;
}

/* Broyden's method, as twin/force_balance.h has it. */
int servotwin_balanced_pair(double motor, double load, double inverse[2][2], double tolerance,
                            void (*miss)(void* of, double motor, double load, double out[2]),
                            void* of) {
  double left[2];
  miss(of, motor, load, left);
  for (int trial = 0;; ++trial) {
    if (fabs(left[0]) <= tolerance && fabs(left[1]) <= tolerance) return 1;
    if (trial == 12) return 0;
    const double step[2] = {-(inverse[0][0] * left[0] + inverse[0][1] * left[1]),
                            -(inverse[1][0] * left[0] + inverse[1][1] * left[1])};
    double next[2];
    motor += step[0];
    load += step[1];
    miss(of, motor, load, next);
    const double change[2] = {next[0] - left[0], next[1] - left[1]};
    const double expected[2] = {inverse[0][0] * change[0] + inverse[0][1] * change[1],
                                inverse[1][0] * change[0] + inverse[1][1] * change[1]};
    const double product = step[0] * expected[0] + step[1] * expected[1];
    if (!(fabs(product) > 1e-9 * (step[0] * step[0] + step[1] * step[1]))) return 0;
    const double row[2] = {step[0] * inverse[0][0] + step[1] * inverse[1][0],
                           step[0] * inverse[0][1] + step[1] * inverse[1][1]};
    for (int i = 0; i < 2; ++i) {
      inverse[0][i] += (step[0] - expected[0]) / product * row[i];
      inverse[1][i] += (step[1] - expected[1]) / product * row[i];
      left[i] = next[i];
    }
  }
}
