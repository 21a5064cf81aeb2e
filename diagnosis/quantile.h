// Order statistics. Any thread.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <vector>

namespace servotwin {

/// The quantile of the values at the share `at`, 0..1; `values` must not be empty.
[[nodiscard]] inline double quantile(const Eigen::ArrayXd& values, double at) {
  std::vector<double> sorted(values.data(), values.data() + values.size());
  const auto place =
      sorted.begin() + static_cast<std::ptrdiff_t>(at * static_cast<double>(sorted.size() - 1));
  std::nth_element(sorted.begin(), place, sorted.end());
  return *place;
}

}  // namespace servotwin
