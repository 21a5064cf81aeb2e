// Limits of a correction: peak, rate, and 0 at both ends.
//
//   |u_k| <= peak,   |u_k - u_(k-1)| <= rate h,   u_0 = u_(N-1) = 0
//
// `limited` gives a correction that obeys them. It takes the middle between the highest signal of
// that slope below u and the lowest one above it, which of all signals of that slope is nearest to
// u in the maximum norm, and clips it, which keeps the slope. A correction that already obeys is
// not changed.
//
// Positions in the unit of the axis [m | rad]; h is the sampling time [s]. Errors: none. Any
// thread. Source: docs/theory.md 13.4.
#pragma once

#include <Eigen/Core>
#include <limits>

namespace servotwin {

struct CorrectionLimits {
  double peak = std::numeric_limits<double>::infinity();  ///< [m | rad], > 0
  double rate = std::numeric_limits<double>::infinity();  ///< [m/s | rad/s], > 0
};

[[nodiscard]] Eigen::ArrayXd limited(const Eigen::ArrayXd& u, const CorrectionLimits& limits,
                                     double h);

}  // namespace servotwin
