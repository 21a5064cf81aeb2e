// Coordinates in which the nonlinear parameters are searched: those of the denominator, and those
// of the effects' shapes.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <vector>

#include "twin/effect.h"
#include "twin/loop.h"

namespace servotwin {

/// Coordinates q of the denominator. kStable: all of R^n is the set of stable loops
/// (a1 = e^q1, a2 = e^q2, a3 = a1 a2 / (1 + e^-q3), Routh-Hurwitz). kPoles: log(p, omega, zeta),
/// for a box.
enum class Chart { kStable, kPoles };

[[nodiscard]] std::array<double, kMaxOrder> denominator_at(Chart chart, int order, const double* q);
/// d a_i / d q_j.
[[nodiscard]] Eigen::Matrix3d chart_jacobian(Chart chart, int order, const double* q);
/// The inverse of denominator_at; `poles` names them for kPoles.
[[nodiscard]] std::vector<double> chart_of(Chart chart, int order,
                                           const std::array<double, kMaxOrder>& a,
                                           const PoleSet& poles);

/// A shape parameter of the search: how it is stretched (logarithmic where its physical bounds are
/// positive), and where it may go.
struct ShapeAxis {
  double lower = -1e300, upper = 1e300;  ///< of the coordinate
  bool logarithmic = false;
  Parameter parameter;

  [[nodiscard]] double value(double coordinate) const;
  [[nodiscard]] double coordinate(double value) const;
};

[[nodiscard]] ShapeAxis shape_axis(const Parameter& parameter);
/// Of all shapes of these effects, in their order, on an axis with this stretch (twin/effect.h).
[[nodiscard]] std::vector<ShapeAxis> shape_axes(const std::vector<std::size_t>& effects,
                                                double length_scale);

}  // namespace servotwin
