// A one-sided CUSUM: notices that the mean of a sequence has grown (Page 1954).
//
//   S_j = max(0, S_(j-1) + z_j - k),   alarm where S_j > h
//
// z: in units of its standard deviation, mean 0 as long as nothing has changed. k: the drift, half
// of the growth to be noticed. h: the threshold, chosen by how long it may run between false
// alarms. The average run length for normal z of mean m, with d = m - k and b = h + 1.166 (Siegmund
// 1985, Sequential Analysis, 2.6):
//
//   ARL = (exp(-2 d b) + 2 d b - 1) / (2 d^2),   b^2 where d = 0
//
// That is for independent z. Of a sequence whose values hang together the long-run deviation takes
// the place of the standard deviation: the sum of many is what S sees.
//
// Any thread, no clock. Errors: std::invalid_argument for a drift or run length that is not
// positive.
#pragma once

#include <cstddef>
#include <vector>

namespace servotwin {

/// Steps until the alarm from S = 0, on average. `mean` of z; 0: until a false one.
[[nodiscard]] double average_run_length(double drift, double threshold, double mean = 0.0);

/// The threshold at which false alarms are `run_length` steps apart on average; 0 where even that
/// is far enough.
[[nodiscard]] double threshold_for(double drift, double run_length);

struct SteadyLevel {
  double mean = 0.0;
  double deviation = 0.0;       ///< long-run
  double mean_error = 0.0;      ///< standard error of the mean
  double variance_error = 0.0;  ///< relative standard error of the long-run variance
};

/// Level of a stretch of a sequence in which nothing changes, at least 8 values. The long-run
/// variance is the sum of the autocovariances with Bartlett's weights over `lags` (Newey and West
/// 1987), at least the variance itself: a sequence that swings is not taken for a quiet one.
[[nodiscard]] SteadyLevel level_of(const std::vector<double>& values, std::size_t lags);

class Cusum {
 public:
  Cusum() = default;
  Cusum(double drift, double threshold) : drift_(drift), threshold_(threshold) {}

  /// True while the alarm lasts: from S > h until S is back at 0. S does not grow beyond h, so that
  /// it comes back as soon as the mean does. What is not finite is left out.
  bool add(double z) noexcept;
  [[nodiscard]] bool raised() const noexcept { return raised_; }
  [[nodiscard]] double sum() const noexcept { return sum_; }
  [[nodiscard]] double threshold() const noexcept { return threshold_; }

 private:
  double drift_ = 0.5, threshold_ = 0.0;
  double sum_ = 0.0;
  bool raised_ = false;
};

}  // namespace servotwin
