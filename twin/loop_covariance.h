// Joint covariance of the values of an identified loop. Values estimated from one motion are
// correlated; standard deviations of single values overstate the certainty of some combinations and
// understate that of others.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "twin/loop.h"

namespace servotwin {

/// Order: real pole, natural frequency [rad/s], damping ratio, c0..c2 [1/s^i], delay [s].
inline constexpr int kLoopValues = 3 + kMaxOrder + 1;
/// Rows and columns of values that the loop does not have, or that are known exactly, are 0.
using LoopCovariance = Eigen::Matrix<double, kLoopValues, kLoopValues>;

/// Standard deviations of the parameters of two masses (twin/two_mass_axis.h), taken as independent
/// of those of the loop. NaN or 0: not stated.
struct TwoMassDeviations {
  double omega = 0.0, zeta = 0.0, load_share = 0.0, reset = 0.0;
};

/// What an identification states of the certainty of its loop. NaN or 0: not stated.
struct StatedDeviations {
  PoleSet poles;                              ///< standard deviations
  std::array<double, kMaxOrder> numerator{};  ///< standard deviations of c0..c2
  double delay_s = 0.0;                       ///< standard deviation
  TwoMassDeviations two_masses;
  std::optional<LoopCovariance> covariance;  ///< nothing where not estimated
  double holdout_over_training = 0.0;        ///< ratio of the RMS errors
};

}  // namespace servotwin
