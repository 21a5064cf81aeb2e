#include "daemon/input/frame_join.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

#include "daemon/between/clock.h"

namespace servotwin::daemon {
namespace {

// A cycle waits this long for the second stream, in cycles of the slower one: one until its next
// sample, and two for its way. Samples that are further apart have others missing between them.
constexpr std::int64_t kPatience_cycles = 3;

}  // namespace

FrameJoin::FrameJoin(std::vector<JoinedAxis> axes, std::array<double, 2> cycles_s,
                     std::array<bool, 2> by_wall_clock)
    : axes_(std::move(axes)),
      wait_ns_(kPatience_cycles * std::llround(1e9 * std::max(cycles_s[0], cycles_s[1]))),
      by_wall_clock_(by_wall_clock) {
  bool there = !axes_.empty() && axes_.size() <= static_cast<std::size_t>(kMaxAxes);
  for (const JoinedAxis& axis : axes_) {
    for (const JoinedAxis::Place& place : {axis.command, axis.actual}) {
      there = there && place.stream < 2 && place.axis < static_cast<std::size_t>(kMaxAxes);
      if (!there) break;
      int& least = axes_of_[place.stream];
      least = std::max(least, static_cast<int>(place.axis) + 1);
    }
  }
  if (!there || !(std::min(cycles_s[0], cycles_s[1]) > 0.0))
    throw std::invalid_argument("joined frames need a cycle and 1 to " + std::to_string(kMaxAxes) +
                                " axes of theirs");
}

void FrameJoin::add_first(const MachineFrame& frame, std::int64_t arrival_ns) noexcept {
  if (!by_wall_clock_[0]) lines_[0].add(frame.time_ns, arrival_ns);
  if (waiting_count_ == kWaiting) {
    first_waiting_ = (first_waiting_ + 1) % kWaiting;
    --waiting_count_;
  }
  Waiting& last = waiting_[(first_waiting_ + waiting_count_) % kWaiting];
  last.frame = frame;
  last.arrival_ns = arrival_ns;
  ++waiting_count_;
}

const FrameJoin::Sample& FrameJoin::back(std::size_t before) const noexcept {
  return samples_[(newest_ + kSamples - before) % kSamples];
}

void FrameJoin::add_second(const Sample& sample) noexcept {
  if (!by_wall_clock_[1]) lines_[1].add(sample.stamp_ns, sample.arrival_ns);
  newest_ = (newest_ + 1) % kSamples;
  samples_[newest_] = sample;
  sample_count_ = std::min(sample_count_ + 1, kSamples);
}

std::int64_t FrameJoin::steady_of(std::size_t stream, std::int64_t stamp_ns) const noexcept {
  return by_wall_clock_[stream] ? between_ns(wall_ahead_ns_, stamp_ns)
                                : lines_[stream].steady_ns(stamp_ns);
}

bool FrameJoin::between(std::int64_t moment_ns, Between& out) const noexcept {
  const auto time = [&](std::size_t i) { return steady_of(1, back(i).stamp_ns); };
  for (std::size_t i = 0; i + 1 < sample_count_; ++i) {
    const std::int64_t before = time(i + 1), after = time(i);
    if (between_ns(moment_ns, before) > 0) continue;
    const auto step = static_cast<double>(between_ns(before, after)),
               x = static_cast<double>(between_ns(before, moment_ns));
    if (!(step > 0.0 && step <= static_cast<double>(wait_ns_)) || x > step) return false;
    out.after = x / step;
    out.samples = {&back(i + 1), &back(i + 1), &back(i)};
    out.weights = {0.0, 1.0 - out.after, out.after};
    if (i + 2 >= sample_count_) return true;
    // The parabola through one sample more: at 5 m/s^2 a straight line between samples 1 ms apart
    // misses 0.6 um.
    const auto last_step = static_cast<double>(between_ns(time(i + 2), before));
    // With a short step before a long one it would make ten of the noise of a reading.
    constexpr double kMinRatio = 0.5;
    if (!(last_step >= kMinRatio * step && last_step <= static_cast<double>(wait_ns_))) return true;
    out.samples[0] = &back(i + 2);
    out.weights = {x * (x - step) / (last_step * (last_step + step)),
                   (x + last_step) * (step - x) / (last_step * step),
                   x * (x + last_step) / (step * (step + last_step))};
    return true;
  }
  return false;
}

void FrameJoin::join(const MachineFrame& first, std::int64_t moment_ns,
                     MachineFrame& frame) noexcept {
  Between at;
  const bool known = clocks_known() && between(moment_ns, at);
  if (known) {
    ++present_;
  } else if (clocks_known()) {
    ++clocks_.absent;
  }
  const auto position = [&](std::size_t axis, double AxisSample::*channel) {
    double sum = 0.0;
    for (std::size_t i = 0; i < at.samples.size(); ++i) {
      if (at.weights[i] != 0.0) sum += at.weights[i] * at.samples[i]->axes[axis].*channel;
    }
    return sum;
  };
  frame.sequence = first.sequence;
  frame.time_ns = first.time_ns;
  // A frame of another machine: the loop refuses one without axes.
  frame.axis_count = first.axis_count < axes_of_[0] ? 0 : static_cast<int>(axes_.size());
  frame.ahead_count = first.ahead_count;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    const auto& [command, actual] = axes_[i];
    AxisSample& out = frame.axes[i];
    out = {};
    frame.ahead[i] = first.ahead[command.axis];
    if (command.stream == 0) {
      out.command = first.axes[command.axis].command;
    } else {
      frame.ahead_count = 0;  // those of all axes or of none
      if (known) out.command = position(command.axis, &AxisSample::command);
    }
    if (actual.stream == 0) {
      out.actual = first.axes[actual.axis].actual;
      out.torque = first.axes[actual.axis].torque;
    } else if (known) {
      out.actual = position(actual.axis, &AxisSample::actual);
      const double before = at.samples[1]->axes[actual.axis].torque;
      out.torque = before + at.after * (at.samples[2]->axes[actual.axis].torque - before);
    }
  }
}

void FrameJoin::compare_clocks(std::int64_t stamp_ns) noexcept {
  clocks_.settled = clocks_known() && sample_count_ > 0;
  if (!clocks_.settled) return;
  const std::int64_t second_ns = back(0).stamp_ns,
                     later_ns = between_ns(steady_of(0, stamp_ns), steady_of(1, second_ns)),
                     later_by_stamps_ns = between_ns(stamp_ns, second_ns);
  clocks_.ahead_s = 1e-9 * static_cast<double>(between_ns(later_ns, later_by_stamps_ns));
  // The steady clock gains less on the faster one.
  clocks_.drift = lines_[0].drift() - lines_[1].drift();
}

bool FrameJoin::take(MachineFrame& frame, std::int64_t now_ns) noexcept {
  if (waiting_count_ == 0) return false;
  const Waiting& oldest = waiting_[first_waiting_];
  const std::int64_t moment = steady_of(0, oldest.frame.time_ns);
  const bool complete =
      !clocks_known() ||
      (sample_count_ > 0 && between_ns(moment, steady_of(1, back(0).stamp_ns)) >= 0) ||
      between_ns(oldest.arrival_ns, now_ns) >= wait_ns_;
  if (!complete) return false;
  join(oldest.frame, moment, frame);
  compare_clocks(oldest.frame.time_ns);
  moment_ns_ = moment;
  first_waiting_ = (first_waiting_ + 1) % kWaiting;
  --waiting_count_;
  return true;
}

}  // namespace servotwin::daemon
