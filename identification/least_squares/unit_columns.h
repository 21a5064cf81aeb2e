// The forces per unit coefficient of one effect along a motion: the columns of its least squares
// problem, and their derivatives by the effect's shapes.
#pragma once

#include <ceres/jet.h>

#include <Eigen/Core>
#include <array>
#include <vector>

#include "twin/catalogue.h"

namespace servotwin {

struct UnitColumns {
  Eigen::ArrayXXd force;                  ///< samples x coefficients
  std::vector<Eigen::ArrayXXd> by_shape;  ///< for every shape the derivative of `force`
};

/// `motion_at(k)` is the motion at sample k = 0 .. n - 1, taken in this order.
template <class MotionAt>
[[nodiscard]] UnitColumns unit_columns(std::size_t kind, const double* shapes, Eigen::Index n,
                                       const MotionAt& motion_at, bool derivatives) {
  const std::size_t coefficients = coefficients_of(kind).size(),
                    shape_count = shapes_of(kind).size();
  UnitColumns out;
  out.force.resize(n, static_cast<Eigen::Index>(coefficients));
  if (!derivatives || shape_count == 0) {
    EffectMemory<double> memory;
    start_memory<double>(kind, shapes, memory);
    std::array<double, kMaxCoefficients> force{};
    for (Eigen::Index k = 0; k < n; ++k) {
      unit_forces<double>(kind, shapes, memory, motion_at(k), force.data());
      for (std::size_t c = 0; c < coefficients; ++c)
        out.force(k, static_cast<Eigen::Index>(c)) = force[c];
    }
    return out;
  }
  using Jet = ceres::Jet<double, kMaxShapes>;
  out.by_shape.assign(shape_count, out.force);
  std::array<Jet, kMaxShapes> shape{};
  for (std::size_t p = 0; p < shape_count; ++p) shape[p] = Jet(shapes[p], static_cast<int>(p));
  EffectMemory<Jet> memory;
  start_memory<Jet>(kind, shape.data(), memory);
  std::array<Jet, kMaxCoefficients> force{};
  for (Eigen::Index k = 0; k < n; ++k) {
    unit_forces<Jet>(kind, shape.data(), memory, motion_at(k), force.data());
    for (std::size_t c = 0; c < coefficients; ++c) {
      const auto column = static_cast<Eigen::Index>(c);
      out.force(k, column) = force[c].a;
      for (std::size_t p = 0; p < shape_count; ++p)
        out.by_shape[p](k, column) = force[c].v(static_cast<Eigen::Index>(p));
    }
  }
  return out;
}

}  // namespace servotwin
