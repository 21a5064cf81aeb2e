#include "identification/loop/deviations.h"

#include <algorithm>
#include <cmath>

#include "identification/loop/output_error.h"
#include "identification/loop/structure_choice.h"
#include "twin/linear_algebra.h"

namespace servotwin {

void set_deviations(ModelRecord& record, const PoleSet& poles, const Eigen::MatrixXd& all,
                    Eigen::Index nonlinear) {
  const int n = record.model.loop.order;
  const auto sd = [&](Eigen::Index i) { return std::sqrt(std::max(0.0, all(i, i))); };
  for (int i = 0; i < n; ++i) record.numerator_deviation[static_cast<std::size_t>(i)] = sd(i);
  for (int i = 0; i < n; ++i)
    record.denominator_deviation[static_cast<std::size_t>(i)] = sd(nonlinear + i);

  // From a1..an to the poles: the inverse Jacobian of the coefficients by the poles.
  Eigen::MatrixXd by_poles(n, n);
  std::array<double, 3> pole{poles.real, poles.omega, poles.zeta};
  for (int j = 0; j < n; ++j) {
    const auto k = static_cast<std::size_t>(n == 3 ? j : j + 1);
    auto up = pole, down = pole;
    const double d = 1e-6 * std::max(std::abs(pole[k]), 1e-6);
    up[k] += d, down[k] -= d;
    const auto a_up = denominator_of({up[0], up[1], up[2]}, n),
               a_down = denominator_of({down[0], down[1], down[2]}, n);
    for (int i = 0; i < n; ++i) {
      const auto row = static_cast<std::size_t>(i);
      by_poles(i, j) = (a_up[row] - a_down[row]) / (2.0 * d);
    }
  }
  // The values of loop_covariance.h by those of `all`.
  Eigen::MatrixXd values = Eigen::MatrixXd::Zero(kLoopValues, all.cols());
  values.block(3 - n, nonlinear, n, n) = inverse(by_poles);
  for (int i = 0; i < n; ++i) values(3 + i, i) = 1.0;

  Eigen::Index shape = nonlinear + n, linear = n;
  for (const Effect& effect : record.model.effects) {
    EffectDeviations deviations;
    if (effect.kind == kind_of<TimeDelay>()) values(kLoopValues - 1, shape) = 1.0;
    for (std::size_t p = 0; p < shapes_of(effect.kind).size(); ++p)
      deviations.shape[p] = sd(shape++);
    std::size_t c = 0;
    for (const Parameter& parameter : coefficients_of(effect.kind)) {
      deviations.coefficient[c++] =
          told_from_loop(parameter, record.model.loop.order) ? sd(linear++) : kAbsent;
    }
    record.effect_deviations.push_back(deviations);
  }
  for (std::size_t i = 0; i < record.model.loop.modes.size(); ++i) {
    record.mode_deviations.push_back(
        {sd(shape), sd(shape + 1), sd(linear), sd(linear + 1), sd(shape + 2), sd(shape + 3)});
    shape += kModeShapes;
    linear += 2;
  }
  for (std::size_t i = 0; i < record.mode_deviations.size() && shape < all.cols(); ++i) {
    record.mode_deviations[i].slope = sd(shape++);
    record.mode_deviations[i].curve = sd(shape++);
    record.mode_deviations[i].zeta_slope = sd(shape++);
  }
  const LoopCovariance covariance = values * all * values.transpose();
  if (covariance.allFinite()) record.loop_covariance = 0.5 * (covariance + covariance.transpose());
  const auto pole_sd = [&](int i) { return std::sqrt(std::max(0.0, covariance(i, i))); };
  record.pole_deviation = {pole_sd(0), pole_sd(1), pole_sd(2)};
}

namespace {

EffectDeviations unknown() {
  EffectDeviations out;
  out.shape.fill(kAbsent);
  out.coefficient.fill(kAbsent);
  return out;
}

}  // namespace

void set_deviations(ModelRecord& record, const std::vector<Segment>& training,
                    double encoder_step) {
  const Structure structure = structure_of(record.model);
  record.numerator_deviation.fill(kAbsent);
  record.denominator_deviation.fill(kAbsent);
  record.pole_deviation = {kAbsent, kAbsent, kAbsent};
  record.loop_covariance.reset();
  record.mode_deviations.clear();
  record.effect_deviations.clear();
  const PoleLabels labels = labels_of(record.model.loop);
  if (const auto covariance = covariance_at(training, structure, record.model, encoder_step);
      covariance && labels.count > 0)
    set_deviations(record, labels.set.front(), *covariance,
                   structure.order + structure.coefficient_count());
  record.effect_deviations.resize(record.model.effects.size(), unknown());
}

}  // namespace servotwin
