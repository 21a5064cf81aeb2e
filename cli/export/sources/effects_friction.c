/* Laws of friction; see effects.h. Source: twin/effects/, twin/maxwell_slip.h,
 * twin/virgin_curve.h. */
#include <math.h>

#include "effects.h"

void servotwin_coulomb_friction(const double* shape, EffectMemory* memory, const Motion* m,
                                double* force) {
  (void)memory;
  force[0] = servotwin_saturated(m->velocity, shape[0]);
  force[1] = m->velocity;
}

/* Length of the end tangents of the virgin curve. */
static double spline_length(double phi) {
  if (phi <= 0.0125) return 8.0 * phi;
  if (phi <= 0.3875) return 0.1;
  if (phi <= 0.875) return 8.0 * phi - 3.0;
  return 4.0 + 14.19 * (phi - 0.875);
}

static double virgin_displacement(double phi, double length, double tau) {
  return tau * tau *
         ((3.0 + length - 8.0 * phi) + (16.0 * phi - 3.0 * length - 2.0) * tau +
          (2.0 * length - 8.0 * phi) * tau * tau);
}

static void reduced_elements(double breakaway_displacement, double phi, double* stiffness,
                             double* level) {
  const double length = spline_length(phi);
  double x[kElements + 1], slope[kElements + 1];
  double force_before = 0.0;
  x[0] = 0.0;
  for (int j = 1; j <= kElements; ++j) {
    const double tau = (double)j / (double)kElements;
    const double force = j == kElements ? 1.0 : 1.0 - virgin_displacement(phi, length, 1.0 - tau);
    x[j] = j == kElements ? 1.0 : virgin_displacement(phi, length, tau);
    slope[j - 1] = (force - force_before) / (x[j] - x[j - 1]);
    force_before = force;
  }
  slope[kElements] = 0.0;
  for (int j = 0; j < kElements; ++j) {
    const double difference = slope[j] - slope[j + 1];
    stiffness[j] = difference / breakaway_displacement;
    level[j] = difference * x[j + 1];
  }
}

void servotwin_presliding_start(const double* shape, EffectMemory* memory) {
  reduced_elements(shape[0], shape[1], memory->springs.stiffness, memory->springs.level);
}

void servotwin_presliding(const double* shape, EffectMemory* memory, const Motion* m,
                          double* force) {
  double sum = 0.0;
  (void)shape;
  for (int i = 0; i < kElements; ++i) {
    const double level = memory->springs.level[i];
    double pulled = memory->springs.force[i] + memory->springs.stiffness[i] * m->displacement;
    if (pulled > level) {
      pulled = level;
    } else if (pulled < -level) {
      pulled = -level;
    }
    memory->springs.force[i] = pulled;
    sum += pulled;
  }
  force[0] = sum;
  force[1] = m->velocity;
}

void servotwin_smoothed_presliding(const double* shape, EffectMemory* memory, const Motion* m,
                                   double* force) {
  const double sign = m->displacement > 0.0 ? 1.0 : -1.0;
  double sum = 0.0;
  (void)shape;
  for (int i = 0; i < kElements; ++i) {
    double* f = &memory->springs.force[i];
    if (m->displacement != 0.0) {
      const double level = sign * memory->springs.level[i];
      *f = level + (*f - level) * exp(-fabs(m->displacement) * memory->springs.stiffness[i] /
                                      memory->springs.level[i]);
    }
    sum += *f;
  }
  force[0] = sum;
  force[1] = m->velocity;
}

/* Travel in a cycle below which an element moves less towards its level [m | rad]. */
static const double kCreep = 1e-10;

/* One cycle of an element that approaches its level at `rate` while it slides. */
static void advance(AttractedElement* element, double stiffness, double level, double rate,
                    double dx, double step_s) {
  if (dx == 0.0) return;
  const int direction = dx > 0.0 ? 1 : -1;
  const double sign = direction;
  if (element->sliding != direction) element->sliding = 0;
  if (element->sliding == 0) {
    const double pulled = element->force + stiffness * dx;
    if (sign * pulled < level) {
      element->force = pulled;
      return;
    }
    element->sliding = direction;
    if (sign * element->force < level) {
      element->force = sign * level;
      return;
    }
  }
  const double moving = fabs(dx) / (fabs(dx) + kCreep);
  element->force = sign * level + (element->force - sign * level) * exp(-rate * (moving * step_s));
}

void servotwin_gms_start(const double* shape, EffectMemory* memory) {
  for (int i = 0; i < kFreeElements; ++i) {
    const double share = (double)i / (double)(kFreeElements - 1);
    memory->attracted.stiffness[i] =
        exp(-(log(shape[0]) + share * (log(shape[1]) - log(shape[0]))));
  }
}

void servotwin_gms(const double* shape, EffectMemory* memory, const Motion* m, double* force) {
  const double q = m->velocity / shape[3];
  const double level = 1.0 + (shape[2] - 1.0) * exp(-q * q);
  for (int i = 0; i < kFreeElements; ++i) {
    advance(&memory->attracted.element[i], memory->attracted.stiffness[i], level, shape[4] / level,
            m->displacement, m->step_s);
    force[i] = memory->attracted.element[i].force;
  }
  force[kFreeElements] = m->velocity;
}

/* For elements whose levels are the first coefficients. */
static double friction_of(int elements, const double* coefficient, const double* force) {
  double sum = 0.0, level = 0.0;
  for (int i = 0; i < elements; ++i) {
    sum += coefficient[i] * force[i];
    level += coefficient[i];
  }
  return level > 0.0 ? sum / level : NAN;
}

double servotwin_gms_friction(const double* coefficient, const double* force) {
  return friction_of(kFreeElements, coefficient, force);
}

void servotwin_maxwell_slip_start(const double* shape, EffectMemory* memory) {
  double displacement = shape[0];
  for (int i = 0; i < kSlipElements; ++i) {
    if (i > 0) displacement *= shape[i];
    memory->springs.stiffness[i] = 1.0 / displacement;
  }
}

void servotwin_maxwell_slip(const double* shape, EffectMemory* memory, const Motion* m,
                            double* force) {
  (void)shape;
  for (int i = 0; i < kSlipElements; ++i) {
    double pulled = memory->springs.force[i] + memory->springs.stiffness[i] * m->displacement;
    if (pulled > 1.0) {
      pulled = 1.0;
    } else if (pulled < -1.0) {
      pulled = -1.0;
    }
    memory->springs.force[i] = pulled;
    force[i] = pulled;
  }
  force[kSlipElements] = m->velocity;
}

double servotwin_maxwell_slip_friction(const double* coefficient, const double* force) {
  return friction_of(kSlipElements, coefficient, force);
}

void servotwin_lugre(const double* shape, EffectMemory* memory, const Motion* m, double* force) {
  const double speed = fabs(m->velocity);
  double level = 1.0;
  if (speed > 0.0) {
    level += (shape[1] - 1.0) * exp(-pow(speed / shape[2], shape[3]));
  } else {
    level = shape[1];
  }
  const double before = memory->value;
  if (m->displacement != 0.0) {
    const double end = m->displacement > 0.0 ? level : -level;
    memory->value = end + (before - end) * exp(-fabs(m->displacement) / (level * shape[0]));
  }
  force[0] = memory->value + shape[4] * (memory->value - before) / m->step_s;
  force[1] = m->velocity;
}

void servotwin_dahl(const double* shape, EffectMemory* memory, const Motion* m, double* force) {
  if (m->displacement != 0.0) {
    const double level = m->displacement > 0.0 ? 1.0 : -1.0;
    memory->value = level + (memory->value - level) * exp(-fabs(m->displacement) / shape[0]);
  }
  force[0] = memory->value;
  force[1] = m->velocity;
}

void servotwin_stribeck(const double* shape, EffectMemory* memory, const Motion* m, double* force) {
  const int plus = m->velocity >= 0.0;
  const int here = plus ? 0 : 1;
  const double speed = fabs(m->velocity);
  const double ramp = speed / shape[3];
  const double level = ramp > 1.0 ? 1.0 : ramp;
  const double drop = speed > 0.0 ? level * exp(-pow(speed / shape[here], shape[2])) : 0.0;
  (void)memory;
  for (int i = 0; i < 6; ++i) force[i] = 0.0;
  force[here] = plus ? level : -level;
  force[2 + here] = plus ? drop : -drop;
  force[4 + here] = m->velocity;
}

double servotwin_stribeck_friction(const double* coefficient, const double* force) {
  (void)coefficient;
  return force[0] + force[1];
}

void servotwin_modified_stribeck(const double* shape, EffectMemory* memory, const Motion* m,
                                 double* force) {
  const int here = m->velocity >= 0.0 ? 0 : 1;
  const double speed = fabs(m->velocity);
  const double direction = tanh(m->velocity / shape[3]);
  (void)memory;
  for (int i = 0; i < 6; ++i) force[i] = 0.0;
  force[here] = direction;
  force[2 + here] = speed > 0.0 ? direction * exp(-pow(speed / shape[here], shape[2])) : 0.0;
  force[4 + here] = m->velocity;
}

void servotwin_presliding_stribeck_start(const double* shape, EffectMemory* memory) {
  reduced_elements(shape[0], shape[1], memory->attracted.stiffness, memory->attracted.level);
  for (int i = 0; i < kElements; ++i) memory->attracted.stiffness[i] *= shape[2];
}

void servotwin_presliding_stribeck(const double* shape, EffectMemory* memory, const Motion* m,
                                   double* force) {
  const double q = m->velocity / shape[3];
  const double level = 1.0 + (shape[2] - 1.0) * exp(-q * q);
  const double rate = shape[4] / level;
  force[0] = 0.0;
  for (int i = 0; i < kElements; ++i) {
    advance(&memory->attracted.element[i], memory->attracted.stiffness[i],
            memory->attracted.level[i] * level, rate, m->displacement, m->step_s);
    force[0] += memory->attracted.element[i].force;
  }
  force[1] = m->velocity;
}
