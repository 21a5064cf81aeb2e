#include "diagnosis/torque/plateau.h"

#include <algorithm>
#include <cmath>

#include "diagnosis/statistics/chance.h"
#include "identification/recording/order_statistics.h"

namespace servotwin {

namespace {

// Force levels, as shares of the level before or after the reversal: the band around zero lies
// within kBandLevel; slopes beside it are taken from there to kSlopeLevel.
constexpr double kBandLevel = 0.1, kSlopeLevel = 0.7;
// Share of the 90 % quantile of the force that both levels must reach: below it the axis does not
// slide.
constexpr double kMinSlidingForce = 0.3;
// Share of the travel between two reversals below which they do not count.
constexpr double kMinStrokeShare = 0.05;
constexpr double kNoGapRatio = 1.25;  // ratio of slopes that filters and rough guideways can reach
constexpr std::size_t kMinReversals = 4;
constexpr double kMinZ = 3.0;
constexpr double kMaxDeviationOverWidth = 0.5;
// Deviation of the logarithm of the speeds below which they count as equal.
constexpr double kMaxSpeedDeviation = 0.2;

double robust_deviation(const std::vector<double>& values) {
  const double centre = median(values);
  std::vector<double> away;
  for (const double value : values) away.push_back(std::abs(value - centre));
  return 1.4826 * median(away);
}

/// Samples at which the position reverses, with a travel of at least `least` between them.
std::vector<Eigen::Index> reversals_of(const Eigen::ArrayXd& x, double least) {
  std::vector<Eigen::Index> out;
  Eigen::Index high = 0, low = 0;
  int direction = 0;
  for (Eigen::Index k = 1; k < x.size(); ++k) {
    if (x(k) > x(high)) high = k;
    if (x(k) < x(low)) low = k;
    if (direction >= 0 && x(high) - x(k) > least) {
      if (direction > 0) out.push_back(high);
      direction = -1;
      low = k;
    } else if (direction <= 0 && x(k) - x(low) > least) {
      if (direction < 0) out.push_back(low);
      direction = 1;
      high = k;
    }
  }
  return out;
}

/// The first index, interpolated between samples, from `from` on at which the values reach this
/// level from below; -1: never.
double reached(const std::vector<double>& values, double level, double from) {
  for (auto k = static_cast<std::size_t>(from); k + 1 < values.size(); ++k) {
    if (values[k] > level || values[k + 1] <= level) continue;
    return static_cast<double>(k) + (level - values[k]) / (values[k + 1] - values[k]);
  }
  return -1.0;
}

/// The value at an interpolated index.
double at(const std::vector<double>& values, double place) {
  const auto k = static_cast<std::size_t>(place);
  const double rest = place - static_cast<double>(k);
  return k + 1 < values.size() ? values[k] + rest * (values[k + 1] - values[k]) : values[k];
}

/// Appends the reversal at sample `from`, with the stroke up to sample `to`, if its force changes
/// sign completely. `least`: force level on both sides that counts as sliding.
void look(const PositionForce& one, Eigen::Index from, Eigen::Index to, double least,
          std::vector<Reversal>& out) {
  const double sign = one.position(to) > one.position(from) ? 1.0 : -1.0;
  std::vector<double> travel, force;
  for (Eigen::Index k = from; k <= to; ++k) {
    travel.push_back(sign * (one.position(k) - one.position(from)));
    force.push_back(sign * one.force(k));
  }
  const double before = -force.front();
  std::vector<double> second(force.begin() + static_cast<std::ptrdiff_t>(force.size() / 2),
                             force.end());
  const double after = median(second);
  if (before < least || after < least) return;
  const double leaves = reached(force, -kSlopeLevel * before, 0.0);
  if (leaves < 0.0) return;
  const double in = reached(force, -kBandLevel * before, leaves);
  if (in < 0.0) return;
  const double passes = reached(force, kBandLevel * after, in);
  if (passes < 0.0) return;
  const double arrives = reached(force, kSlopeLevel * after, passes);
  if (arrives < 0.0) return;
  const double down = at(travel, in) - at(travel, leaves),
               band = at(travel, passes) - at(travel, in),
               up = at(travel, arrives) - at(travel, passes);
  // The band is passed within two samples: too fast to resolve.
  if (passes - in < 2.0 || !(down > 0.0) || !(band > 0.0) || !(up > 0.0)) return;
  const double share = kBandLevel / (kSlopeLevel - kBandLevel);
  Reversal reversal;
  reversal.forward = sign > 0.0;
  reversal.time_s = one.start_s + one.step_s * static_cast<double>(from);
  reversal.ratio =
      ((kSlopeLevel - kBandLevel) * after / up) / (kBandLevel * (before + after) / band);
  reversal.width = band - share * (down + up);
  reversal.passing = (passes - in) * one.step_s;
  out.push_back(reversal);
}

}  // namespace

bool Plateau::found() const {
  return reversals.size() >= kMinReversals && statistic > kMinZ && width > 0.0 &&
         deviation < kMaxDeviationOverWidth * width && by_travel;
}

Plateau plateau_of(const std::vector<PositionForce>& stretches) {
  Plateau out;
  double travel = 0.0;
  std::vector<double> forces;
  for (const PositionForce& one : stretches) {
    travel = std::max(travel, one.position.maxCoeff() - one.position.minCoeff());
    for (const double force : one.force) forces.push_back(std::abs(force));
  }
  if (forces.empty()) return out;
  std::sort(forces.begin(), forces.end());
  const double least = kMinSlidingForce * forces[forces.size() * 9 / 10];
  for (const PositionForce& one : stretches) {
    const std::vector<Eigen::Index> turns = reversals_of(one.position, kMinStrokeShare * travel);
    for (std::size_t i = 0; i < turns.size(); ++i)
      look(one, turns[i], i + 1 < turns.size() ? turns[i + 1] : one.position.size() - 1, least,
           out.reversals);
  }
  if (out.reversals.size() < kMinReversals) return out;
  std::vector<double> ratios, away, speeds, in_travel, in_time;
  for (const Reversal& r : out.reversals) ratios.push_back(std::log(r.ratio / kNoGapRatio));
  out.statistic = z_of_mean(ratios);
  // Deviations from the median of each direction, since the flanks of nuts and guideways differ.
  int directions = 0;
  for (const bool forward : {true, false}) {
    std::vector<double> widths, logarithms, times;
    for (const Reversal& r : out.reversals) {
      if (r.forward != forward) continue;
      widths.push_back(r.width);
      logarithms.push_back(std::log(std::max(r.width, 1e-3 * travel)));
      times.push_back(std::log(r.passing));
    }
    if (widths.empty()) continue;
    ++directions;
    const double width = median(widths);
    (forward ? out.forward : out.backward) = width;
    out.width += width;
    for (std::size_t i = 0; i < widths.size(); ++i) {
      away.push_back(widths[i] - width);
      in_travel.push_back(logarithms[i] - median(logarithms));
      in_time.push_back(times[i] - median(times));
      speeds.push_back(logarithms[i] - times[i]);
    }
  }
  out.width /= directions;
  out.deviation = robust_deviation(away);
  out.by_travel = robust_deviation(speeds) < kMaxSpeedDeviation ||
                  robust_deviation(in_travel) < robust_deviation(in_time);
  return out;
}

Eigen::ArrayXd force_through_gap(const Eigen::ArrayXd& position, double width, double give,
                                 double start) {
  Eigen::ArrayXd out(position.size());
  const double most = 0.5 * width + give;
  double inside = start * most;  // position relative to the middle of the gap
  for (Eigen::Index k = 0; k < position.size(); ++k) {
    if (k > 0) inside = std::clamp(inside + position(k) - position(k - 1), -most, most);
    const double pressed = std::max(0.0, std::abs(inside) - 0.5 * width) / give;
    out(k) = inside > 0.0 ? pressed : -pressed;
  }
  return out;
}

}  // namespace servotwin
