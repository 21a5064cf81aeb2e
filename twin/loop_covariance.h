// Joint covariance of the values of an identified loop. Values estimated from one motion are
// correlated; standard deviations of single values overstate the certainty of some combinations and
// understate that of others.
#pragma once

#include <Eigen/Core>

#include "twin/loop.h"

namespace servotwin {

/// Order: real pole, natural frequency [rad/s], damping ratio, c0..c2 [1/s^i], delay [s].
inline constexpr int kLoopValues = 3 + kMaxOrder + 1;
/// Rows and columns of values that the loop does not have, or that are known exactly, are 0.
using LoopCovariance = Eigen::Matrix<double, kLoopValues, kLoopValues>;

}  // namespace servotwin
