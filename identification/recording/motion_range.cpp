#include "identification/recording/motion_range.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <sstream>
#include <utility>
#include <vector>

#include "identification/recording/order_statistics.h"
#include "twin/effect.h"

namespace servotwin {

MotionRange motion_range(std::span<const Segment> segments) {
  MotionRange out;
  for (const Segment& segment : segments) {
    const double h = segment.sample_time_s;
    const Eigen::Index d = std::max<Eigen::Index>(1, std::lround(MotionRange::kSpan_s / h));
    const Eigen::Index steps = segment.size() - d;
    if (steps <= d) continue;
    const double span_s = h * static_cast<double>(d);
    const Eigen::ArrayXd v = (segment.command.tail(steps) - segment.command.head(steps)) / span_s;
    const double a = (v.tail(steps - d) - v.head(steps - d)).abs().maxCoeff() / span_s;
    out.speed = std::fmax(out.speed, v.abs().maxCoeff());
    out.acceleration = std::fmax(out.acceleration, a);
  }
  return out;
}

namespace {

template <class Part>
double largest_scale(std::span<const Part> parts) {
  double largest = 1.0;
  for (const Part& part : parts) largest = std::max(largest, part.length_scale);
  return largest;
}

}  // namespace

void set_length_scale(std::span<Segment> recording, bool rotary) {
  const double speed = rotary ? motion_range(recording).speed : 0.0;
  for (Segment& s : recording) s.length_scale = std::fmax(1.0, speed / kMachineSpeed);
}

double length_scale(std::span<const Segment> segments) { return largest_scale(segments); }
double length_scale(std::span<const Signals> segments) { return largest_scale(segments); }

namespace {

/// The largest step between two samples at rest, of a command that rests nearly always, as a target
/// does; else 0.
double largest_jump_of_steps(std::span<const Segment> segments) {
  constexpr double kMaxMovingShare = 0.05;  // of the samples
  double largest = 0.0;
  Eigen::Index moving = 0, count = 0;
  for (const Segment& segment : segments) {
    const Eigen::Index steps = segment.size() - 1;
    if (steps < 1) continue;
    const Eigen::ArrayXd step = (segment.command.tail(steps) - segment.command.head(steps)).abs();
    moving += (step > 0.0).count();
    count += steps;
    for (Eigen::Index k = 1; k + 1 < steps; ++k) {
      if (step(k - 1) == 0.0 && step(k + 1) == 0.0) largest = std::max(largest, step(k));
    }
  }
  return static_cast<double>(moving) <= kMaxMovingShare * static_cast<double>(count) ? largest
                                                                                     : 0.0;
}

}  // namespace

std::string why_implausible(std::span<const Segment> segments, bool rotary) {
  // Linear motors reach 10 m/s, gantries 60 m; spindles of 60,000 rpm turn at 6300 rad/s, and a
  // table that turns for an hour at 100 rpm makes 6000 turns.
  constexpr double kFastest_m_s = 20.0, kLongest_m = 100.0, kFastest_rad_s = 10'000.0;
  const MotionRange range = motion_range(segments);
  std::ostringstream out;
  out.precision(3);
  // A set-point that rests and jumps by 2 mm in 1 ms is none: the drive's interpolator is behind
  // it.
  constexpr double kFastestJump_m_s = 2.0;
  const double jump = largest_jump_of_steps(segments);
  const double jump_speed = segments.empty() ? 0.0 : jump / segments.front().sample_time_s;
  if (jump_speed > (rotary ? kFastest_rad_s : kFastestJump_m_s)) {
    out << "jumps by up to " << jump << (rotary ? " rad" : " m")
        << " and rests in between: it is a target, and not the set-point that the drive follows; "
           "record the command behind the interpolator";
    return out.str();
  }
  if (range.speed > (rotary ? kFastest_rad_s : kFastest_m_s)) {
    out << "moves at up to " << range.speed << (rotary ? " rad/s" : " m/s");
  } else if (!rotary) {
    double lowest = HUGE_VAL, highest = -HUGE_VAL;
    for (const Segment& segment : segments) {
      lowest = std::min(lowest, segment.command.minCoeff());
      highest = std::max(highest, segment.command.maxCoeff());
    }
    if (highest - lowest > kLongest_m) out << "travels " << highest - lowest << " m";
  }
  if (out.str().empty()) return {};
  return out.str() + ", which no servo axis does: is its unit " +
         (rotary ? "deg and not rad?" : "mm and not m? Is the time in ms?");
}

std::string why_not_following(std::span<const Segment> segments, bool rotary) {
  // Between these quantiles, so that single wrong values do not count.
  constexpr double kLow = 0.01, kHigh = 0.99;
  const auto travel = [&](const Eigen::ArrayXd Segment::*values) {
    std::vector<double> all;
    for (const Segment& segment : segments) {
      const Eigen::ArrayXd& x = segment.*values;
      all.insert(all.end(), x.begin(), x.end());
    }
    return all.empty() ? 0.0 : quantile(all, kHigh) - quantile(all, kLow);
  };
  const double commanded = travel(&Segment::command), actual = travel(&Segment::actual);
  if (!(commanded > 0.0) ||
      (actual <= kMaxTravelRatio * commanded && commanded <= kMaxTravelRatio * actual))
    return {};
  // What one number is in the other unit.
  constexpr std::array<std::pair<double, const char*>, 3> kLinear{
      {{1e3, "is one of them in mm and the other in um?"},
       {25.4, "is one of them in inches?"},
       {10.0, "is one of them in mm and the other in cm?"}}};
  constexpr std::array<std::pair<double, const char*>, 2> kRotary{
      {{180.0 / std::numbers::pi, "is one of them in degrees and the other in radians?"},
       {360.0, "is one of them in turns and the other in degrees?"}}};
  constexpr double kFollows = 1.05;  // how exactly an axis follows over its travel
  const double ratio = std::max(actual / commanded, commanded / actual);
  const char* guess = "is it the position error, a velocity, or of another axis?";
  const auto try_these = [&](const auto& units) {
    for (const auto& [factor, question] : units) {
      if (ratio < factor * kFollows && ratio > factor / kFollows) guess = question;
    }
  };
  rotary ? try_these(kRotary) : try_these(kLinear);
  std::ostringstream out;
  out.precision(3);
  const char* unit = rotary ? " rad" : " m";
  out << "travels " << actual << unit << " where the command travels " << commanded << unit << ": "
      << guess;
  return out.str();
}

}  // namespace servotwin
