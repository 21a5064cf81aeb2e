// How probable the reading of an encoder with a step is, as the residual that least squares needs
// (output_error.h).
//
// Lengths in m or rad. Does not throw, allocates nothing. Any thread.
#pragma once

#include <algorithm>
#include <cmath>
#include <numbers>

namespace servotwin {

/// - log P(r) above its least value, as half a square: the residual that least squares needs.
class ReadingLikelihood {
 public:
  ReadingLikelihood(double encoder_step, double sigma)
      : half_(0.5 * encoder_step / sigma), sigma_(sigma) {
    least_ = minus_log(0.0);
    const double density = std::exp(-0.5 * half_ * half_) / std::sqrt(2.0 * std::numbers::pi);
    const double inside = std::erf(half_ / std::numbers::sqrt2);
    curvature_ = half_ > 1e-3 ? 2.0 * half_ * density / inside : 1.0;
  }
  /// - log P per sample, with the constants that depend on sigma.
  [[nodiscard]] double minus_log_likelihood(double r) const {
    return minus_log(std::abs(r) / sigma_) +
           (half_ > 1e-3 ? 0.0 : std::log(sigma_ * std::sqrt(2.0 * std::numbers::pi)));
  }
  [[nodiscard]] double residual(double r) const {
    const double size = std::sqrt(2.0 * std::max(0.0, minus_log(std::abs(r) / sigma_) - least_));
    return r < 0.0 ? -size : size;
  }
  /// d residual / d r.
  [[nodiscard]] double slope(double r) const {
    const double size = std::abs(residual(r));
    if (size < 1e-5) return std::sqrt(curvature_) / sigma_;
    return score(std::abs(r) / sigma_) / size / sigma_;
  }

 private:
  static double log_tail(double t) {  // log Phi(-t)
    if (t < 6.0) return std::log(0.5 * std::erfc(t / std::numbers::sqrt2));
    const double u = 1.0 / (t * t);
    return -0.5 * t * t - std::log(t * std::sqrt(2.0 * std::numbers::pi)) +
           std::log1p(-u * (1.0 - 3.0 * u * (1.0 - 5.0 * u)));
  }
  /// t = |r| / sigma.
  [[nodiscard]] double minus_log(double t) const {
    if (half_ <= 1e-3) return 0.5 * t * t;
    // Phi(half - t) - Phi(-half - t): two tails of one side.
    const double near = log_tail(t - half_), far = log_tail(t + half_);
    return -(near + std::log1p(-std::exp(std::min(0.0, far - near))));
  }
  /// d minus_log / dt.
  [[nodiscard]] double score(double t) const {
    if (half_ <= 1e-3) return t;
    const auto log_density = [](double z) {
      return -0.5 * z * z - 0.5 * std::log(2.0 * std::numbers::pi);
    };
    const double log_p = -minus_log(t);
    return std::exp(log_density(t - half_) - log_p) - std::exp(log_density(t + half_) - log_p);
  }

  double half_, sigma_, least_ = 0.0, curvature_ = 1.0;
};

}  // namespace servotwin
