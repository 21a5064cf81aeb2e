#include "identification/recording/same_axis.h"

#include <cmath>

#include "identification/recording/regression.h"

namespace servotwin {

namespace {

using Lag = Regression<3>;

constexpr double kLagStep_s = 0.01;  // longer than the noise of a difference, shorter than a motion

void add_rows(std::span<const Segment> segments, Lag& lag) {
  for (const Segment& s : segments) {
    if (s.actual.size() != s.size()) continue;
    const auto step = std::max<Eigen::Index>(
        1, static_cast<Eigen::Index>(std::lround(kLagStep_s / s.sample_time_s)));
    const double h = static_cast<double>(step) * s.sample_time_s;
    for (Eigen::Index k = step; k + step < s.size(); k += step) {
      const double before = s.command(k - step), now = s.command(k), next = s.command(k + step);
      const double velocity = (next - before) / (2.0 * h);
      lag.add({velocity, (next - 2.0 * now + before) / (h * h),
               static_cast<double>((velocity > 0.0) - (velocity < 0.0)), now - s.actual(k)});
    }
  }
}

}  // namespace

double common_over_own(std::span<const Segment> one, std::span<const Segment> other) {
  Lag first, second, both;
  add_rows(one, first);
  add_rows(other, second);
  add_rows(one, both);
  add_rows(other, both);
  if (first.count() == 0 || second.count() == 0) return 1.0;
  const auto square = [](const Lag& lag) {
    return static_cast<double>(lag.count()) * std::pow(lag.fit().rms, 2);
  };
  const double own = square(first) + square(second);
  return own > 0.0 ? std::sqrt(square(both) / own) : 1.0;
}

}  // namespace servotwin
