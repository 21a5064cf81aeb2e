#include "identification/torque/ramps.h"

#include <algorithm>
#include <cmath>

#include "identification/recording/noise_floor.h"

namespace servotwin {

namespace {

// Mean motion per window in encoder steps, enough to distinguish standing from moving.
constexpr double kStepsPerWindow = 20.0;
constexpr double kShortestWindow_s = 2e-3;
// Speed over the mean: below the first the axis stands, above the second it jumps.
constexpr double kMaxStandingSpeedRatio = 0.2, kMinJumpSpeedRatio = 2.0;
constexpr double kMinStandingTimeShare = 0.05;  // of the time
constexpr double kMinJumpTravelShare = 0.2;     // of the travel
// Allowed deviation of a rounded command from a line.
constexpr double kMaxLineDeviationSteps = 0.6;
constexpr int kBatches = 20;

struct Run {
  Eigen::Index begin = 0, end = 0;  // first and last sample
};

/// The longest runs of samples that lie within `tolerance` of the line from their first one: the
/// slopes that every further sample allows are intersected until none is left. A run whose first
/// sample lies slightly off its line ends early; following samples on the same line belong to it.
std::vector<Run> straight_runs(const Eigen::ArrayXd& x, double tolerance) {
  std::vector<Run> runs;
  Eigen::Index begin = 0;
  while (begin + 1 < x.size()) {
    double low = -1e300, high = 1e300;
    Eigen::Index end = begin;
    for (Eigen::Index k = begin + 1; k < x.size(); ++k) {
      const auto steps = static_cast<double>(k - begin);
      low = std::max(low, (x(k) - tolerance - x(begin)) / steps);
      high = std::min(high, (x(k) + tolerance - x(begin)) / steps);
      if (low > high) break;
      end = k;
    }
    const auto slope = [&x](Eigen::Index from, Eigen::Index to) {
      return (x(to) - x(from)) / static_cast<double>(to - from);
    };
    if (!runs.empty()) {
      Run& before = runs.back();
      const auto shorter = static_cast<double>(std::min(end - begin, before.end - before.begin));
      if (std::abs(slope(before.begin, before.end) - slope(begin, end)) * shorter <=
          2.0 * tolerance) {
        before.end = end;
        begin = end;
        continue;
      }
    }
    runs.push_back({begin, end});
    begin = end;
  }
  return runs;
}

/// Standard deviation of the mean of correlated values, from the means of batches.
double deviation_of_mean(const Eigen::ArrayXd& values) {
  const Eigen::Index length = values.size() / kBatches;
  if (length < 1) return kAbsent;
  Eigen::ArrayXd means(kBatches);
  for (int i = 0; i < kBatches; ++i) means(i) = values.segment(i * length, length).mean();
  return std::sqrt((means - means.mean()).square().sum() / (kBatches - 1) / kBatches);
}

void judge_steadiness(const Eigen::ArrayXd& position, double h, double encoder_step, Ramp& ramp) {
  const double speed = std::abs(ramp.velocity);
  const double window_s = std::max(kShortestWindow_s, kStepsPerWindow * encoder_step / speed);
  const auto window = static_cast<Eigen::Index>(std::ceil(window_s / h));
  const Eigen::Index count = (position.size() - 1) / window;
  if (count < 10) return;
  Eigen::ArrayXd velocity(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    velocity(i) =
        (position((i + 1) * window) - position(i * window)) / (static_cast<double>(window) * h);
  }
  const Eigen::ArrayXd share = velocity / ramp.velocity;
  ramp.ripple = std::sqrt((share - share.mean()).square().mean());
  const auto part = [&](auto&& condition) {
    return static_cast<double>(condition.count()) / static_cast<double>(count);
  };
  const double jumped =
      (share > kMinJumpSpeedRatio).select(share, 0.0).sum() / static_cast<double>(count);
  ramp.judged = true;
  ramp.stick_slip =
      part(share < kMaxStandingSpeedRatio) > kMinStandingTimeShare && jumped > kMinJumpTravelShare;
}

}  // namespace

std::vector<Ramp> ramps_of(const std::vector<Segment>& segments, const RampOptions& options) {
  const double encoder_step = noise_floor(segments).encoder_step;
  std::vector<Segment> commands = segments;
  for (Segment& s : commands) s.actual = s.command;
  const double tolerance =
      std::max(options.tolerance, kMaxLineDeviationSteps * noise_floor(commands).encoder_step);
  std::vector<Ramp> ramps;
  for (const Segment& s : segments) {
    if (s.torque.size() == 0) continue;
    const double h = s.sample_time_s;
    for (const Run& run : straight_runs(s.command, tolerance)) {
      if (std::abs(s.command(run.end) - s.command(run.begin)) < options.least_travel) continue;
      Eigen::Index begin = run.begin, end = run.end;
      if (options.band) {
        const auto outside = [&](Eigen::Index k) {
          return std::abs(s.actual(k) - options.centre) > 0.5 * *options.band;
        };
        while (begin <= end && outside(begin)) ++begin;
        while (end >= begin && outside(end)) --end;
      } else {
        const auto cut = static_cast<Eigen::Index>(0.5 * (1.0 - options.middle) *
                                                   static_cast<double>(end - begin));
        begin += cut;
        end -= cut;
      }
      const Eigen::Index n = end - begin + 1;
      if (static_cast<double>(n - 1) * h < options.shortest_s) continue;
      const Eigen::ArrayXd torque = s.torque.segment(begin, n);
      const Eigen::ArrayXd position = s.actual.segment(begin, n);
      if (!torque.isFinite().all()) continue;
      Ramp ramp;
      ramp.begin_s = s.start_s + h * static_cast<double>(begin);
      ramp.end_s = s.start_s + h * static_cast<double>(end);
      ramp.velocity = (position(n - 1) - position(0)) / (static_cast<double>(n - 1) * h);
      if (ramp.velocity == 0.0) continue;
      ramp.torque = torque.mean();
      ramp.torque_deviation = deviation_of_mean(torque);
      judge_steadiness(position, h, encoder_step, ramp);
      ramps.push_back(ramp);
    }
  }
  return ramps;
}

double stick_slip_below(const std::vector<Ramp>& ramps) {
  double highest = 0.0;
  for (const Ramp& ramp : ramps) {
    if (ramp.stick_slip) highest = std::max(highest, std::abs(ramp.velocity));
  }
  return highest;
}

}  // namespace servotwin
