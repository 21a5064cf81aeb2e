// Covariance of least squares estimates with correlated residuals (Newey and West 1987). The
// residuals of a twin are correlated in time; the formula for independent residuals would give
// deviations that are too small. Any thread. Allocates.
#pragma once

#include <Eigen/Core>

namespace servotwin {

/// `jacobian` of the residuals by the parameters, one row per sample `h` [s] apart; correlation is
/// taken over 50 ms, with Bartlett weights. Columns may differ in size by any order.
[[nodiscard]] Eigen::MatrixXd robust_covariance(const Eigen::MatrixXd& jacobian,
                                                const Eigen::VectorXd& residual, double h);

}  // namespace servotwin
