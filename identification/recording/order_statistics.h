// Median and quantiles. Any thread; the values must be finite.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <vector>

namespace servotwin {

/// The quantile that counts as the peak of a motion: a single jump of the command in 10 s of motion
/// at 1 kHz is ignored.
inline constexpr double kPeakQuantile = 0.995;

/// The value that a share 0..1 of the others does not exceed; 0 of no values.
[[nodiscard]] inline double quantile(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

[[nodiscard]] inline double quantile(const Eigen::ArrayXd& values, double share) {
  return quantile(std::vector<double>(values.begin(), values.end()), share);
}

/// The upper one of the two in the middle; 0 of no values.
[[nodiscard]] inline double median(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

}  // namespace servotwin
