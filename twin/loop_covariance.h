// How far the values of an identified loop may be off, all of them together: what is estimated from
// one motion hangs together, and values taken one by one promise too much here and too little
// there.
#pragma once

#include <Eigen/Core>

#include "twin/loop.h"

namespace servotwin {

/// In this order: real pole, natural frequency [rad/s], damping ratio, c0..c2 [1/s^i], delay [s].
inline constexpr int kLoopValues = 3 + kMaxOrder + 1;
/// Rows and columns of what a loop has not, or what is certain, are 0.
using LoopCovariance = Eigen::Matrix<double, kLoopValues, kLoopValues>;

}  // namespace servotwin
