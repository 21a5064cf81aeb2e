// What the residual depends on, one variable at a time, and what chance would show.
//
//   share  = sum_b n_b (mean_b - mean)^2 / sum_k (r_k - mean)^2       over bins b of the variable
//   chance = the share that 1 in 1000 shuffles of the residual reaches (position in a period: 1 in
//            100, the best of all periods each time)
//
// The residual is shuffled in blocks longer than it remembers (ten times the area under its
// autocorrelation), so that chance is not underrated. A position within a period is sought over all
// periods from a two-hundredth of the way to a third of it; its share is that of sine and cosine.
// The shares are of each variable alone: variables that go together share what they explain.
//
// Units: SI. Deterministic. Any thread. Source: one-way analysis of variance with block permutation
// (Fisher 1925; Kuensch 1989 for the blocks).
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <string_view>
#include <vector>

#include "diagnosis/residual.h"

namespace servotwin {

enum class Regressor {
  kVelocity,
  kDirection,
  kPosition,
  kPositionInPeriod,
  kAcceleration,
  kTimeSinceReversal,
  kTimeSinceRest,
  kTime,
};
inline constexpr std::size_t kRegressors = 8;

[[nodiscard]] std::string_view name_of(Regressor regressor);  ///< "velocity", ..

struct RegressorShare {
  Regressor regressor = Regressor::kVelocity;
  double share = 0.0;   ///< of the residual's variance; 0 where the recording does not vary it
  double chance = 0.0;  ///< level that chance reaches
  double period = 0.0;  ///< of kPositionInPeriod [m | rad]
  bool significant = false;
};
using RegressorShares = std::array<RegressorShare, kRegressors>;  ///< in the order above

[[nodiscard]] RegressorShares by_regressor(std::span<const ResidualStretch> stretches);

/// Samples of a stretch by the variables; NaN where one has no value.
struct Variables {
  Eigen::ArrayXd velocity, acceleration, position, time;
  Eigen::ArrayXd since_reversal_s, since_rest_s;  ///< NaN before the first
  Eigen::ArrayXd travel;                          ///< since the last reversal [m | rad]
};
[[nodiscard]] Variables variables_of(const ResidualStretch& stretch);

/// Means of y over bins of x.
struct Bin {
  double x = 0.0;          ///< mean of x in it
  double mean = 0.0;       ///< of y
  double deviation = 0.0;  ///< standard deviation of the mean, from runs of samples in the bin
  Eigen::Index count = 0;
};
/// At most `most` bins of equal width with at least 8 samples; samples without a value are left
/// out.
[[nodiscard]] std::vector<Bin> bins_of(const Eigen::ArrayXd& x, const Eigen::ArrayXd& y, int most);

}  // namespace servotwin
