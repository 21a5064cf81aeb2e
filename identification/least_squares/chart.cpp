#include "identification/least_squares/chart.h"

#include <algorithm>
#include <cmath>

#include "twin/catalogue.h"

namespace servotwin {

std::array<double, kMaxOrder> denominator_at(Chart chart, int order, const double* q) {
  if (chart == Chart::kPoles) {
    if (order == 2) return denominator_of({0.0, std::exp(q[0]), std::exp(q[1])}, 2);
    return denominator_of({std::exp(q[0]), std::exp(q[1]), std::exp(q[2])}, 3);
  }
  const double a1 = std::exp(q[0]);
  const double a2 = std::exp(q[1]);
  if (order == 2) return {a1, a2, 0.0};
  return {a1, a2, a1 * a2 / (1.0 + std::exp(-q[2]))};
}

Eigen::Matrix3d chart_jacobian(Chart chart, int order, const double* q) {
  Eigen::Matrix3d j = Eigen::Matrix3d::Zero();
  if (chart == Chart::kPoles) {
    const double p = order == 2 ? 0.0 : std::exp(q[0]);
    const double omega = std::exp(q[order - 2]);
    const double zeta = std::exp(q[order - 1]);
    if (order == 2) {
      j << 2 * zeta * omega, 2 * omega * zeta, 0, 2 * omega * omega, 0, 0, 0, 0, 0;
    } else {
      j << p, 2 * zeta * omega, 2 * omega * zeta,                                          //
          2 * zeta * omega * p, (2 * omega + 2 * zeta * p) * omega, 2 * omega * p * zeta,  //
          omega * omega * p, 2 * p * omega * omega, 0;
    }
    return j;
  }
  const auto a = denominator_at(chart, order, q);
  j(0, 0) = a[0];
  j(1, 1) = a[1];
  if (order == 3) {
    j(2, 0) = a[2];
    j(2, 1) = a[2];
    j(2, 2) = a[2] / (1.0 + std::exp(q[2]));
  }
  return j;
}

std::vector<double> chart_of(Chart chart, int order, const std::array<double, kMaxOrder>& a,
                             const PoleSet& poles) {
  if (chart == Chart::kPoles) {
    if (order == 2) return {std::log(poles.omega), std::log(poles.zeta)};
    return {std::log(poles.real), std::log(poles.omega), std::log(poles.zeta)};
  }
  if (order == 2) return {std::log(a[0]), std::log(a[1])};
  const double kappa = std::clamp(a[2] / (a[0] * a[1]), 1e-9, 1.0 - 1e-9);
  return {std::log(a[0]), std::log(a[1]), std::log(kappa / (1.0 - kappa))};
}

double ShapeAxis::value(double coordinate) const {
  // exp(log(bound)) may miss the bound by a digit.
  return std::clamp(logarithmic ? std::exp(coordinate) : coordinate, parameter.lower,
                    parameter.upper);
}

double ShapeAxis::coordinate(double value) const {
  return std::clamp(logarithmic ? std::log(value) : value, lower, upper);
}

ShapeAxis shape_axis(const Parameter& p) {
  if (p.lower > 0.0) return {std::log(p.lower), std::log(p.upper), true, p};
  return {p.lower, p.upper, false, p};
}

std::vector<ShapeAxis> shape_axes(const std::vector<std::size_t>& effects, double length_scale) {
  std::vector<ShapeAxis> axes;
  for (std::size_t kind : effects) {
    for (const Parameter& p : shapes_of(kind))
      axes.push_back(shape_axis(stretched(p, length_scale)));
  }
  return axes;
}

}  // namespace servotwin
