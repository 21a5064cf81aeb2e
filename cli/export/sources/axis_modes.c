/* The modes' part of a step where modes of vibration move with position: at_place of twin/loop.cpp,
 * twin/mode_step.h, and place_modes of twin/step_constants.cpp, translated line by line. Symbols
 * and sources are explained there. */
#include <math.h>

#include "axis.h"

static double clamped(double value, double least, double most) {
  if (value < least) return least;
  return most < value ? most : value;
}

/* The commanded position in the travel: -1 at its beginning, 1 at its end, constant beyond. */
static double place_of(const AxisModel* model, double position) {
  const double from = model->travel[0], to = model->travel[1];
  return to > from ? clamped((2.0 * position - from - to) / (to - from), -1.0, 1.0) : 0.0;
}

/* A mode at one position; `lag`: the increase of c(n-1) there. */
typedef struct {
  AxisMode mode;
  double lag;
} PlacedMode;

static PlacedMode at_place(const AxisModel* model, const AxisMode* mode, double place) {
  PlacedMode out = {*mode, 0.0};
  if (mode->slope == 0.0 && mode->curve == 0.0 && mode->zeta_slope == 0.0) return out;
  const double last = model->denominator[model->order - 1];
  const double middle = mode->omega * mode->omega;
  out.mode.omega = mode->omega * exp(place * (mode->slope + mode->curve * place));
  out.mode.zeta = mode->zeta * exp(mode->zeta_slope * place);
  const double here = out.mode.omega * out.mode.omega;
  out.lag = last * mode->beta * (1.0 / middle - 1.0 / here);
  const double most_change = 2.0;
  const double before = middle - last, after = here - last;
  if (model->order == 2 && before * after > 0.0)
    out.mode.delta *= clamped(before / after * here / middle, 1.0 / most_change, most_change);
  return out;
}

enum { kInputs = 4, kTerms = 24, kTermsOfSmallStep = 13 };
static const double kMaxSmallStep_rad2 = 0.25;

/* One step of a mode: every phi_j is p_j + q_j A. */
typedef struct {
  double damping, stiffness;
  double p[kInputs], q[kInputs];
} ModeStep;

static ModeStep mode_step(double damping, double stiffness, double step_s) {
  ModeStep step = {damping, stiffness, {0}, {0}};
  const int terms = stiffness * step_s * step_s < kMaxSmallStep_rad2 ? kTermsOfSmallStep : kTerms;
  double term = 1.0; /* 1 / j! */
  for (int j = 2; j <= terms; ++j) term /= j;
  double p = term, q = 0.0;
  for (int j = terms - 1; j >= 0; --j) {
    term *= j + 1;
    const double above = p;
    p = term - step_s * stiffness * q;
    q = step_s * (above - damping * q);
    if (j < kInputs) {
      step.p[j] = p;
      step.q[j] = q;
    }
  }
  return step;
}

/* phi_j times the vector (first, second). */
static void times(const ModeStep* step, int j, double first, double second, double* product) {
  product[0] = step->p[j] * first + step->q[j] * (second - step->damping * first);
  product[1] = step->p[j] * second - step->q[j] * step->stiffness * first;
}

/* The step of the two states of a mode at this position over a part. */
static void place_rows(const AxisMode* mode, double h, AxisRow* row) {
  const ModeStep step = mode_step(2.0 * mode->zeta * mode->omega, mode->omega * mode->omega, h);
  double left[2], right[2], by_command[2], by_force[2], by_rise[2];
  times(&step, 0, 1.0, 0.0, left);
  times(&step, 0, 0.0, 1.0, right);
  times(&step, 1, mode->gamma, mode->delta, by_force);
  times(&step, 2, mode->gamma, mode->delta, by_rise);
  for (int r = 0; r < 2; ++r) {
    row[r].phi[0] = left[r];
    row[r].phi[1] = right[r];
    row[r].force_end = h * by_rise[r];
    row[r].force_begin = h * by_force[r] - row[r].force_end;
  }
  double power = h;
  for (int k = 0; k < 3; ++k, power *= h) {
    times(&step, k + 1, mode->alpha, mode->beta, by_command);
    for (int r = 0; r < 2; ++r) row[r].command[k] = power * by_command[r];
  }
}

/* d/dt of a reading. */
static void rate_of(const AxisModel* model, const AxisMode* here, const double* of, double* out) {
  const int n = model->order;
  for (int block = 0; block < 2; ++block) {
    const int first = block * n;
    for (int c = 0; c < n; ++c) {
      out[first + c] =
          (c > 0 ? of[first + c - 1] : 0.0) - of[first + n - 1] * model->denominator[n - 1 - c];
    }
  }
  for (int i = 0; i < model->modes; ++i) {
    const int first = 2 * n + 2 * i;
    out[first] = -2.0 * here[i].zeta * here[i].omega * of[first] -
                 here[i].omega * here[i].omega * of[first + 1];
    out[first + 1] = of[first];
  }
}

/* The direct share of the command's velocity in the rate of a reading, */
static double command_at_once(const AxisModel* model, const AxisMode* here, const double* of) {
  double sum = of[model->order - 1];
  for (int i = 0; i < model->modes; ++i) {
    const int at = 2 * model->order + 2 * i;
    sum += of[at] * here[i].alpha + of[at + 1] * here[i].beta;
  }
  return sum;
}

/* and of the force. */
static double force_at_once(const AxisModel* model, const AxisMode* here, const double* of) {
  double sum = of[2 * model->order - 1];
  for (int i = 0; i < model->modes; ++i) {
    const int at = 2 * model->order + 2 * i;
    sum += of[at] * here[i].gamma + of[at + 1] * here[i].delta;
  }
  return sum;
}

void servotwin_place_modes(const AxisModel* model, double over, double at_end, AxisStep* step) {
  const double h = model->cycle_s / model->parts;
  const int n = model->order;
  double error[kMaxStates] = {0}, rate[kMaxStates] = {0}, second[kMaxStates] = {0};
  double share = 1.0; /* of a disturbance that does not act through the modes */
  AxisMode here[kMaxModes];
  for (int i = 0; i < n; ++i) error[i] = model->numerator[n - 1 - i];
  for (int i = 0; i < model->modes; ++i) {
    const int first = 2 * n + 2 * i;
    AxisRow* row = &step->row[first];
    const PlacedMode middle = at_place(model, &model->mode[i], place_of(model, over));
    place_rows(&middle.mode, h, row);
    const PlacedMode placed = at_place(model, &model->mode[i], place_of(model, at_end));
    const AxisMode* end = &placed.mode;
    const double damping = 2.0 * end->zeta * end->omega, stiffness = end->omega * end->omega;
    here[i] = placed.mode;
    error[first] = 1.0;
    error[0] += placed.lag;
    error[2 * n - 1] -= end->gamma;
    if (n == 3) error[n] -= end->delta * model->denominator[2] / stiffness;
    share -= end->gamma * (model->denominator[0] - damping) + end->delta;
    row[0].rest = end->delta / stiffness;
    row[1].rest = damping * end->delta / stiffness - end->gamma;
  }
  error[2 * n - 2] += share;

  rate_of(model, here, error, rate);
  rate_of(model, here, rate, second);
  step->error_force_end = step->rate_force_end = step->second_force_end = 0.0;
  for (int i = 0; i < model->states; ++i) {
    AxisRow* row = &step->row[i];
    row->error = error[i];
    row->rate = rate[i];
    row->second = second[i];
    step->error_force_end += error[i] * row->force_end;
    step->rate_force_end += rate[i] * row->force_end;
    step->second_force_end += second[i] * row->force_end;
  }
  step->rate_velocity = command_at_once(model, here, error);
  step->second_velocity = command_at_once(model, here, rate);
  step->second_acceleration = step->rate_velocity;
  step->second_force = force_at_once(model, here, rate);
}
