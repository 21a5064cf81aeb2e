// How much of the residual each variable explains on its own, and how much chance would explain.
//
//   share  = sum_b n_b (mean_b - mean)^2 / sum_k (r_k - mean)^2       over bins b of the variable
//   chance = the share that 1 in 1000 shuffles of the residual reaches (position in a period: 1 in
//            100, the best of all periods each time)
//
// The residual is shuffled in blocks longer than its correlation time (ten times the area under its
// autocorrelation), so that chance is not underestimated. For the position within a period, all
// periods from 1/200 to 1/3 of the travel are tried; its share is that of a sine and a cosine. Each
// share is that of one variable alone: the shares of correlated variables overlap.
//
// Units: SI. Deterministic. Any thread. Source: one-way analysis of variance with block permutation
// (Fisher 1925; Kuensch 1989 for the blocks).
#pragma once

#include <Eigen/Core>
#include <array>
#include <span>
#include <string_view>
#include <vector>

#include "diagnosis/statistics/residual.h"

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
  double share = 0.0;   ///< of the residual variance; 0 where the variable does not vary
  double chance = 0.0;  ///< share that chance reaches
  double period = 0.0;  ///< of kPositionInPeriod [m | rad]
  bool significant = false;
};
using RegressorShares = std::array<RegressorShare, kRegressors>;  ///< in the order above

/// The share of every variable; all 0 where there are fewer than 200 samples.
[[nodiscard]] RegressorShares by_regressor(std::span<const ResidualStretch> stretches);

/// The values of the variables in every sample of a stretch; NaN where a variable has no value.
struct Variables {
  Eigen::ArrayXd velocity, acceleration, position, time;
  Eigen::ArrayXd since_reversal_s, since_rest_s;  ///< NaN before the first reversal or rest
  Eigen::ArrayXd travel;                          ///< since the last reversal [m | rad]
};
[[nodiscard]] Variables variables_of(const ResidualStretch& stretch);

/// One bin of x with the mean of y in it.
struct Bin {
  double x = 0.0;          ///< mean of x in the bin
  double mean = 0.0;       ///< of y
  double deviation = 0.0;  ///< standard deviation of the mean, from runs of samples in the bin
  Eigen::Index count = 0;
};
/// The bins of equal width (`most` over the range of x) that have at least 8 samples. Samples whose
/// x or y is not finite are left out.
[[nodiscard]] std::vector<Bin> bins_of(const Eigen::ArrayXd& x, const Eigen::ArrayXd& y, int most);

}  // namespace servotwin
