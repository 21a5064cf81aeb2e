// The error a full-LS fit predicts as the thesis judges it: its own loop, its own two friction
// levels, switched by the measured velocity (the program itself judges in free simulation).
#pragma once

#include <algorithm>

#include "identification/loop/full_ls.h"

namespace servotwin::test {

inline Eigen::VectorXd full_ls_prediction(const FullLsFit& fit, const Segment& segment) {
  constexpr double kWidth = 1e-3;
  Signals signals = signals_of(segment);
  const double level = std::max(std::abs(fit.friction_positive), std::abs(fit.friction_negative));
  // sat(v / width) of this "velocity" is the switched friction over its larger level.
  signals.velocity = signals.velocity.unaryExpr([&](double v) {
    const double d = v > 0.0 ? fit.friction_positive : (v < 0.0 ? -fit.friction_negative : 0.0);
    return d / level * kWidth;
  });
  const Projection data({signals}, {3, {kind_of<CoulombFriction>()}}, false);
  Point point;
  point.denominator = fit.model.loop.denominator;
  point.shapes = {kWidth};
  const auto& c = fit.model.loop.numerator;
  return data.regressors(point) * Eigen::Vector4d(c[0], c[1], c[2], level);
}

}  // namespace servotwin::test
