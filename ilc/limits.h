// What a correction may be: peak and rate, and nothing at both ends.
//
//   |u_k| <= peak,   |u_k - u_(k-1)| <= rate h,   u_0 = u_(N-1) = 0
//
// `limited` gives a correction that obeys: the middle between the highest signal of that slope
// below u and the lowest one above it, which of all signals of that slope is the nearest to u by
// its largest deviation, then clipped, which leaves the slope. What obeys already is not changed.
//
// Units of position are the axis' own [m | rad]. Any thread.
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
