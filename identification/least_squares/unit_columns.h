// The forces per unit coefficient of one effect along a motion: the columns of its least squares
// problem, and their derivatives by the effect's shapes.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "twin/catalogue.h"

namespace servotwin {

struct UnitColumns {
  Eigen::ArrayXXd force;                  ///< samples x coefficients
  std::vector<Eigen::ArrayXXd> by_shape;  ///< for every shape the derivative of `force`
};

/// `motion`: sample by sample.
[[nodiscard]] UnitColumns unit_columns(std::size_t kind, const double* shapes,
                                       std::span<const Motion> motion, bool derivatives);

}  // namespace servotwin
