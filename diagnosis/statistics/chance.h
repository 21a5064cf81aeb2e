// Significance of test statistics. Any thread.
#pragma once

#include <cmath>
#include <numbers>
#include <vector>

namespace servotwin {

/// The probability that a standard normal variable exceeds z.
[[nodiscard]] inline double chance_beyond(double z) {
  return 0.5 * std::erfc(z / std::numbers::sqrt2);
}

/// z with the same one-sided p as F(k, n) (Wilson and Hilferty 1931, Paulson 1942).
[[nodiscard]] inline double z_of_f_ratio(double f, double k, double n) {
  const double a = 2.0 / (9.0 * k), b = 2.0 / (9.0 * n), root = std::cbrt(f);
  return ((1.0 - b) * root - (1.0 - a)) / std::sqrt(b * root * root + a);
}

/// z with the same one-sided p as Student's t with so many degrees of freedom (Wallace 1959).
[[nodiscard]] inline double z_of_t(double t, double degrees) {
  const double z = std::sqrt(degrees * std::log1p(t * t / degrees)) * (8.0 * degrees + 1.0) /
                   (8.0 * degrees + 3.0);
  return std::copysign(z, t);
}

/// z with the same one-sided p as Student's t test of the mean of these values against 0; 0 where
/// there are fewer than four values or all are equal.
[[nodiscard]] inline double z_of_mean(const std::vector<double>& values) {
  const auto n = static_cast<double>(values.size());
  if (values.size() < 4) return 0.0;
  double mean = 0.0, square = 0.0;
  for (const double value : values) mean += value / n;
  for (const double value : values) square += (value - mean) * (value - mean);
  if (!(square > 0.0)) return 0.0;
  return z_of_t(mean / std::sqrt(square / (n - 1.0) / n), n - 1.0);
}

}  // namespace servotwin
