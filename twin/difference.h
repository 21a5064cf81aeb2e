// Derivatives of a simulation by differences of whole simulations: where exact ones say too little.
// Along a motion that loses and makes contact many times the exact derivative holds between two
// events only; a difference averages over them. Any thread.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "twin/twin.h"

namespace servotwin {

/// Relative change of the parameters for a difference.
inline constexpr double kDifferenceStep = 1e-5;

/// How often a parameter would change by itself in a unit of this direction, at most.
[[nodiscard]] inline double relative_rate(const Model& model, const Model& direction) {
  double most = 0.0;
  Model rates = direction;
  each_parameter(rates, model, [&](double rate, double value) {
    if (value != 0.0) most = std::max(most, std::abs(rate / value));
  });
  return most;
}

/// The derivative of the error along the direction; of one side where the other is no valid model,
/// and NaN where neither is. `error`: that of the model.
[[nodiscard]] inline Eigen::VectorXd difference(const Model& model, const Model& direction,
                                                const Segment& segment, Outputs outputs,
                                                const Eigen::ArrayXd& error) {
  const double rate = relative_rate(model, direction);
  const double step = rate > 0.0 ? kDifferenceStep / rate : kDifferenceStep;
  for (const double by : {step, -step}) {
    Model there = model;
    each_parameter(there, direction, [by](double& x, double change) { x += by * change; });
    if (why_invalid(there).empty())
      return ((simulate(there, segment, outputs) - error) / by).matrix();
  }
  return Eigen::VectorXd::Constant(error.size(), kAbsent);
}

}  // namespace servotwin
