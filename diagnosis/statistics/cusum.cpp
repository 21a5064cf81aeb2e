#include "diagnosis/statistics/cusum.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace servotwin {
namespace {

constexpr double kOvershoot = 1.166;  // of both ends together, for normal steps (Siegmund)

void require_positive(const char* what, double value) {
  if (!(value > 0.0) || !std::isfinite(value))
    throw std::invalid_argument("CUSUM: " + std::string(what) + " must be positive, not " +
                                std::to_string(value));
}

}  // namespace

double average_run_length(double drift, double threshold, double mean) {
  require_positive("the drift", drift);
  const double b = threshold + kOvershoot, d = mean - drift;
  if (std::abs(d * b) < 1e-6) return b * b;
  return (std::exp(-2.0 * d * b) + 2.0 * d * b - 1.0) / (2.0 * d * d);
}

double threshold_for(double drift, double run_length) {
  require_positive("the drift", drift);
  require_positive("the run length", run_length);
  // exp(u) - u - 1 = 2 k^2 ARL with u = 2 k b, by Newton's iteration: from its first step on it is
  // above the solution and comes down to it, as the left side is convex.
  const double target = 2.0 * drift * drift * run_length;
  double u = std::log1p(target) + std::sqrt(2.0 * target) / (1.0 + std::sqrt(target));
  for (int i = 0; i < 100; ++i) {
    const double step = (std::expm1(u) - u - target) / std::expm1(u);
    u -= step;
    if (std::abs(step) < 1e-12 * u) break;
  }
  return std::max(0.0, u / (2.0 * drift) - kOvershoot);
}

SteadyLevel level_of(const std::vector<double>& values, std::size_t lags) {
  if (values.size() < 8)
    throw std::invalid_argument("the level of " + std::to_string(values.size()) +
                                " values cannot be estimated; at least 8 are needed");
  const std::size_t n = values.size();
  const auto count = static_cast<double>(n);
  SteadyLevel out;
  for (const double value : values) out.mean += value / count;
  const auto covariance = [&](std::size_t lag) {
    double sum = 0.0;
    for (std::size_t i = lag; i < n; ++i)
      sum += (values[i] - out.mean) * (values[i - lag] - out.mean);
    return sum / count;
  };
  const double variance = covariance(0);
  double long_run = variance;
  lags = std::min(lags, n - 1);
  for (std::size_t lag = 1; lag <= lags; ++lag) {
    const double weight = 1.0 - static_cast<double>(lag) / static_cast<double>(lags + 1);
    long_run += 2.0 * weight * covariance(lag);
  }
  long_run = std::max(long_run, variance);
  out.deviation = std::sqrt(long_run);
  out.mean_error = std::sqrt(long_run / count);
  // 2 Sum of the squared weights / n (Priestley 1981, 6.2.4); lags = 0: that of a variance.
  out.variance_error = std::sqrt(std::max(2.0, 4.0 / 3.0 * static_cast<double>(lags)) / count);
  return out;
}

bool Cusum::add(double z) noexcept {
  if (!std::isfinite(z)) return raised_;
  sum_ = std::max(0.0, sum_ + z - drift_);
  if (sum_ > threshold_) {
    raised_ = true;
    sum_ = threshold_;
  } else if (sum_ == 0.0) {
    raised_ = false;
  }
  return raised_;
}

}  // namespace servotwin
