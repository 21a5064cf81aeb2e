// The forces per unit coefficient of one effect along a motion: the columns of its least squares
// problem, and their derivatives by the effect's shapes.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "twin/catalogue.h"

namespace servotwin {

struct UnitColumns {
  Eigen::ArrayXXd force;                  ///< samples x coefficients
  std::vector<Eigen::ArrayXXd> by_shape;  ///< for every shape the derivative of `force`
};

/// `motion_at(k)` is the motion at sample k = 0 .. n - 1, taken in this order.
[[nodiscard]] UnitColumns unit_columns(std::size_t kind, const double* shapes, Eigen::Index n,
                                       const std::function<Motion(Eigen::Index)>& motion_at,
                                       bool derivatives);

}  // namespace servotwin
