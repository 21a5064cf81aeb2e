#include "daemon/input/joined_source.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "daemon/between/clock.h"
#include "daemon/between/report_period.h"
#include "drivers/common/text.h"

namespace servotwin::daemon {
namespace {

// How often a waiting cycle looks for a sample of the second source, in parts of a cycle.
constexpr double kLooksPerCycle = 8.0;
constexpr double kFollowerTimeout_s = 0.1;
// Of the first source: as long as the samples of the second have room.
constexpr double kMaxWait_s = 0.02;
// Three times what the clocks take to be known.
constexpr std::int64_t kUnknown_ns = 10'000'000'000;
// Without anything from the second source for so long, it is said at once.
constexpr std::int64_t kGone_ns = 1'000'000'000;

}  // namespace

JoinedSource::JoinedSource(std::array<Part, 2> parts, std::vector<JoinedAxis> axes,
                           std::array<double, 2> cycles_s)
    : parts_(std::move(parts)),
      join_(std::move(axes), cycles_s,
            {parts_[0].source->stamped_here(), parts_[1].source->stamped_here()}),
      look_s_(cycles_s[0] / kLooksPerCycle) {}

void JoinedSource::follow(const std::stop_token& stop) noexcept {
  MachineFrame frame;
  FrameJoin::Sample sample;
  while (!stop.stop_requested()) {
    const Received received = parts_[1].source->receive(frame, kFollowerTimeout_s);
    if (received == Received::kEnd) return;
    if (received == Received::kNothing) continue;
    if (frame.axis_count < join_.axes_of(1)) {
      malformed_.fetch_add(1, std::memory_order_relaxed);  // for display
      continue;
    }
    sample = {frame.time_ns, steady_ns(), frame.axes};
    arrived_.push(sample);  // without room its cycles are absent, and counted there
  }
}

void JoinedSource::read_clocks() noexcept {
  // A thread that is stopped between the two readings would shift all samples.
  constexpr int kReadings = 3;
  constexpr std::int64_t kAtOnce_ns = 5'000;
  std::int64_t least_ns = std::numeric_limits<std::int64_t>::max();
  for (int i = 0; i < kReadings && least_ns > kAtOnce_ns; ++i) {
    const std::int64_t before = steady_ns(), wall = wall_ns(), took_ns = steady_ns() - before;
    if (took_ns >= least_ns) continue;
    least_ns = took_ns;
    join_.set_wall_ahead(wall - before - took_ns / 2);
  }
}

void JoinedSource::publish_clocks() noexcept {
  const ClockDifference& now = join_.clocks();
  settled_.store(now.settled, std::memory_order_relaxed);
  for (std::size_t stream = 0; stream < known_.size(); ++stream)
    known_[stream].store(join_.clock_known(stream), std::memory_order_relaxed);
  ahead_s_.store(now.ahead_s, std::memory_order_relaxed);
  drift_.store(now.drift, std::memory_order_relaxed);
  absent_.store(now.absent, std::memory_order_relaxed);
  present_.store(join_.present(), std::memory_order_relaxed);
}

Received JoinedSource::receive(MachineFrame& frame, double timeout_s) noexcept {
  if (!follower_.joinable())
    follower_ = std::jthread([this](const std::stop_token& stop) { follow(stop); });
  const std::int64_t until = steady_ns() + std::llround(1e9 * timeout_s);
  while (true) {
    read_clocks();
    for (FrameJoin::Sample next; arrived_.pop(next);) join_.add_second(next);
    if (join_.take(frame, steady_ns())) {
      publish_clocks();
      return Received::kFrame;
    }
    if (ended_ && !join_.waiting()) return Received::kEnd;
    const double left_s = 1e-9 * static_cast<double>(until - steady_ns());
    if (!(left_s > 0.0)) return Received::kNothing;
    const Received received =
        parts_[0].source->receive(first_, std::min(left_s, join_.waiting() ? look_s_ : kMaxWait_s));
    if (received == Received::kEnd) ended_ = true;
    if (received == Received::kFrame) join_.add_first(first_, steady_ns());
  }
}

std::int64_t JoinedSource::age_ns() const noexcept {
  return between_ns(join_.moment_ns(), steady_ns());
}

SourceState JoinedSource::state(std::int64_t now_ns) const {
  SourceState out = parts_[0].source->state(now_ns), second = parts_[1].source->state(now_ns);
  out.silent = out.silent || second.silent;
  out.malformed += second.malformed + malformed_.load(std::memory_order_relaxed);
  out.buses.insert(out.buses.end(), second.buses.begin(), second.buses.end());
  out.clocks = {settled_.load(std::memory_order_relaxed), ahead_s_.load(std::memory_order_relaxed),
                drift_.load(std::memory_order_relaxed), absent_.load(std::memory_order_relaxed)};
  return out;
}

void JoinedSource::tell_absent(std::uint64_t absent, std::int64_t now_ns,
                               std::vector<SourceNews>& lines) {
  const std::string& second = parts_[1].name;
  const std::string cycles = counted(absent - reported_absent_, "cycle");
  const std::uint64_t present = present_.load(std::memory_order_relaxed);  // for people
  const bool came = std::exchange(seen_present_, present) < present,
             missed = std::exchange(seen_absent_, absent) < absent;
  // Where neither is so, no cycles come that it could have something for.
  if (came) {
    absent_since_ns_ = 0;
    if (std::exchange(reported_gone_, false)) {
      lines.push_back({second + " is back: it had nothing for " + cycles, true});
      reported_absent_ = absent;
      reported_ns_ = now_ns;
    }
  } else if (missed && absent_since_ns_ == 0) {
    absent_since_ns_ = now_ns;
  } else if (missed && !reported_gone_ && now_ns - absent_since_ns_ >= kGone_ns) {
    reported_gone_ = true;
    lines.push_back({second + " has nothing for the cycles of " + parts_[0].name +
                     ": what it gives is missing"});
  }
  if (reported_gone_ || absent == reported_absent_ ||
      (reported_ns_ != 0 && now_ns - reported_ns_ < kReportPeriod_ns))
    return;
  lines.push_back({second + " had nothing for " + cycles});
  reported_absent_ = absent;
  reported_ns_ = now_ns;
}

std::vector<SourceNews> JoinedSource::news(std::int64_t now_ns) {
  std::vector<SourceNews> lines;
  for (Part& part : parts_) {
    for (SourceNews& line : part.source->news(now_ns)) {
      line.text = part.name + ": " + line.text;
      lines.push_back(std::move(line));
    }
  }
  const ClockDifference now = *state(now_ns).clocks;
  const std::string &first = parts_[0].name, &second = parts_[1].name;
  if (now.settled && !reported_settled_) {
    constexpr double kOtherZero_s = 86'400.0;  // it does not count from when the other one does
    const double ahead_s = std::abs(now.ahead_s);
    lines.push_back(
        {"the clock of " + second + " " +
             (ahead_s > kOtherZero_s ? "has another zero than"
                                     : "is " + number(1e3 * ahead_s) + " ms " +
                                           (now.ahead_s < 0.0 ? "behind" : "ahead of")) +
             " that of " + first + "; what comes from " + second +
             " is taken at the time of each cycle",
         true});
  } else if (!now.settled && reported_settled_) {
    const bool of_first = !known_[0].load(std::memory_order_relaxed),
               of_second = !known_[1].load(std::memory_order_relaxed);
    // Where both or none are unknown by now, either may have been set.
    const std::string which = of_first == of_second ? first + " or " + second
                              : of_first            ? first
                                                    : second;
    lines.push_back({"the clock of " + which + " was set: nothing from " + second +
                     " is used until both are known again"});
  }
  reported_settled_ = now.settled;
  if (now.settled || state(now_ns).silent) {
    unknown_since_ns_ = 0;
    reported_unknown_ = false;
  } else if (unknown_since_ns_ == 0) {
    unknown_since_ns_ = now_ns;
  } else if (!reported_unknown_ && now_ns - unknown_since_ns_ >= kUnknown_ns) {
    reported_unknown_ = true;
    lines.push_back(
        {"the clocks of " + first + " and " + second +
         " are not known: frames of one do not come, or have time stamps that do not go "
         "on; nothing from " +
         second + " is used"});
  }
  tell_absent(now.absent, now_ns, lines);
  return lines;
}

}  // namespace servotwin::daemon
