// Levenberg-Marquardt for nonlinear least squares with bounds.
//
// Every step is the minimum of the damped quadratic model within the bounds, found by its active
// set, and not a step without bounds that is cut off at them: where a parameter lies at its bound,
// as those of friction often do, such a step may lead upwards, and a fit that is cut off stays
// where it is (measurements 20).
//
// Any thread. Source: Nielsen (1999) for the damping; Nocedal and Wright (2006), 16.5, for the
// active set.
#pragma once

#include <Eigen/Core>
#include <functional>

namespace servotwin {

struct BoundedProblem {
  Eigen::VectorXd lower, upper;  ///< of the parameters, at least one; infinite where there is none
  /// The residuals at x, and if asked for their derivatives; false where there are none.
  std::function<bool(const Eigen::VectorXd& x, Eigen::VectorXd& residual,
                     Eigen::MatrixXd* jacobian)>
      evaluate;
};

struct BoundedOptions {
  int rounds = 40;          ///< steps tried at most, 1 or more
  double tolerance = 1e-5;  ///< relative decrease of the cost below which it ends, above 0
};

/// Lowers the sum of squares from `x`, which is finite and is first put within the bounds; `x` is
/// then the best point found. False where there are no residuals or derivatives at the start.
/// Throws Interrupted where the thread is interrupted (interruption.h).
bool fit_within(const BoundedProblem& problem, const BoundedOptions& options, Eigen::VectorXd& x);

/// argmin s'Hs/2 + g's within the bounds; H is positive definite, 0 lies within.
[[nodiscard]] Eigen::VectorXd quadratic_minimum(const Eigen::MatrixXd& h, const Eigen::VectorXd& g,
                                                const Eigen::VectorXd& lower,
                                                const Eigen::VectorXd& upper);

}  // namespace servotwin
