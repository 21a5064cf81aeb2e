// A one-sided CUSUM: detects that the mean of a sequence has increased (Page 1954).
//
//   S_j = max(0, S_(j-1) + z_j - k),   alarm where S_j > h
//
// z: the values in units of their standard deviation, with mean 0 as long as nothing has changed.
// k: the drift, half of the increase to be detected. h: the threshold, chosen by the average time
// between false alarms. The average run length for normal z of mean m, with d = m - k and
// b = h + 1.166 (Siegmund 1985, Sequential Analysis, 2.6):
//
//   ARL = (exp(-2 d b) + 2 d b - 1) / (2 d^2),   b^2 where d = 0
//
// This holds for independent z. For a correlated sequence use the long-run deviation instead of the
// standard deviation, since S is a sum of many values.
//
// Any thread, no clock. Errors: std::invalid_argument for a drift or run length that is not
// positive.
#pragma once

#include <cstddef>
#include <vector>

namespace servotwin {

/// Average number of steps from S = 0 to the alarm, for z of this mean; mean 0: to a false alarm.
[[nodiscard]] double average_run_length(double drift, double threshold, double mean = 0.0);

/// The threshold at which false alarms are `run_length` steps apart on average; 0 where they are
/// further apart even with a threshold of 0.
[[nodiscard]] double threshold_for(double drift, double run_length);

/// Mean and scatter of a sequence without changes.
struct SteadyLevel {
  double mean = 0.0;
  double deviation = 0.0;       ///< long-run
  double mean_error = 0.0;      ///< standard error of the mean
  double variance_error = 0.0;  ///< relative standard error of the long-run variance
};

/// Level of a sequence of at least 8 values in which nothing changes. The long-run variance is the
/// sum of the autocovariances with Bartlett weights over `lags` (Newey and West 1987), and at least
/// the variance itself, so that it is not underestimated for an oscillating sequence.
[[nodiscard]] SteadyLevel level_of(const std::vector<double>& values, std::size_t lags);

class Cusum {
 public:
  Cusum() = default;
  Cusum(double drift, double threshold) : drift_(drift), threshold_(threshold) {}

  /// Adds a value. True while the alarm lasts: from S > h until S has returned to 0. S is limited
  /// to h, so that it returns as soon as the mean does. Values that are not finite are ignored.
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
