#include "daemon/input/clock_line.h"

#include <algorithm>
#include <cmath>

#include "daemon/between/clock.h"

namespace servotwin::daemon {
namespace {

constexpr double kInterval_s = 0.5;  // of each least delay; 64 of them are half a minute
// Over less the jitter of two frames looks like a drift.
constexpr double kDriftFrom_s = 3.0;
constexpr double kMaxDrift = 5e-4;  // of a quartz in heat or cold; more is no clock
// No frame comes so much earlier than the line: the clock was set forward.
constexpr double kSetForward_ns = 0.3e6;
// No jitter keeps all frames of two seconds so much later: it was set back.
constexpr double kSetBack_ns = 1e6;
constexpr int kIntervalsAbove = 4;

}  // namespace

void ClockLine::begin(std::int64_t stamp_ns, std::int64_t arrival_ns) noexcept {
  restarts_ += begun_ ? 1 : 0;
  begun_ = true;
  settled_ = false;
  first_stamp_ns_ = stamp_ns;
  first_arrival_ns_ = arrival_ns;
  points_[0] = {};
  count_ = 1;
  interval_end_s_ = kInterval_s;
  last_stamp_s_ = delay_ns_ = drift_ = least_above_ns_ = 0.0;
  intervals_above_ = 0;
}

void ClockLine::add(std::int64_t stamp_ns, std::int64_t arrival_ns) noexcept {
  if (!begun_) return begin(stamp_ns, arrival_ns);
  const std::int64_t by_stamp_ns = between_ns(first_stamp_ns_, stamp_ns);
  const double stamp_s = 1e-9 * static_cast<double>(by_stamp_ns),
               delay_ns = static_cast<double>(
                   between_ns(by_stamp_ns, between_ns(first_arrival_ns_, arrival_ns)));
  const double above_ns = delay_ns - line_at(stamp_s);
  if (stamp_s < last_stamp_s_ - kInterval_s || (settled_ && above_ns < -kSetForward_ns))
    return begin(stamp_ns, arrival_ns);
  last_stamp_s_ = std::max(last_stamp_s_, stamp_s);
  if (stamp_s >= interval_end_s_) {
    intervals_above_ = least_above_ns_ > kSetBack_ns ? intervals_above_ + 1 : 0;
    if (intervals_above_ == kIntervalsAbove) return begin(stamp_ns, arrival_ns);
    fit();
    if (count_ == kPoints) {
      std::move(points_.begin() + 1, points_.end(), points_.begin());
      --count_;
    }
    points_[count_++] = {stamp_s, delay_ns};
    interval_end_s_ = stamp_s + kInterval_s;
    least_above_ns_ = delay_ns - line_at(stamp_s);
    return;
  }
  Point& least = points_[count_ - 1];
  if (delay_ns < least.delay_ns) least = {stamp_s, delay_ns};
  least_above_ns_ = std::min(least_above_ns_, above_ns);
}

void ClockLine::fit() noexcept {
  // The lower hull of the points, which are sorted by stamp; the edge over their mean is the line
  // with the least sum of delays above it.
  std::array<Point, kPoints> hull;
  std::size_t size = 0;
  double mean_s = 0.0;
  for (std::size_t i = 0; i < count_; ++i) {
    const Point& next = points_[i];
    mean_s += next.stamp_s / static_cast<double>(count_);
    const auto turns_up = [&](const Point& a, const Point& b) {
      return (b.delay_ns - a.delay_ns) * (next.stamp_s - b.stamp_s) <
             (next.delay_ns - b.delay_ns) * (b.stamp_s - a.stamp_s);
    };
    while (size >= 2 && !turns_up(hull[size - 2], hull[size - 1])) --size;
    hull[size++] = next;
  }
  std::size_t end = 1;
  while (end + 1 < size && hull[end].stamp_s < mean_s) ++end;
  const Point &from = hull[end - 1], &to = hull[std::min(end, size - 1)];
  const double span_s = to.stamp_s - from.stamp_s;
  settled_ = kInterval_s * static_cast<double>(count_) >= kDriftFrom_s;
  drift_ = settled_ && span_s > 0.0
               ? std::clamp(1e-9 * (to.delay_ns - from.delay_ns) / span_s, -kMaxDrift, kMaxDrift)
               : 0.0;
  delay_ns_ = points_[0].delay_ns - 1e9 * drift_ * points_[0].stamp_s;
  for (std::size_t i = 1; i < count_; ++i)
    delay_ns_ = std::min(delay_ns_, points_[i].delay_ns - 1e9 * drift_ * points_[i].stamp_s);
}

std::int64_t ClockLine::steady_ns(std::int64_t stamp_ns) const noexcept {
  const std::int64_t by_stamp_ns = between_ns(first_stamp_ns_, stamp_ns);
  const double line_ns = line_at(1e-9 * static_cast<double>(by_stamp_ns));
  // Stamps of any value: wraps around instead of overflowing, as between_ns.
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(first_arrival_ns_) +
                                   static_cast<std::uint64_t>(by_stamp_ns) +
                                   static_cast<std::uint64_t>(std::llround(line_ns)));
}

}  // namespace servotwin::daemon
