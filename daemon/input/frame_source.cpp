#include "daemon/input/frame_source.h"

#include <time.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <stdexcept>
#include <string>

#include "daemon/between/clock.h"
#include "daemon/between/report_period.h"
#include "drivers/common/text.h"

namespace servotwin::daemon {
namespace {

// How often `behind` is asked again.
constexpr std::int64_t kPollPeriod_ns = 1'000'000;

void sleep_until(std::int64_t steady) noexcept {
  const timespec until{static_cast<time_t>(steady / 1'000'000'000),
                       static_cast<long>(steady % 1'000'000'000)};
  while (clock_nanosleep(kSteadyClock, TIMER_ABSTIME, &until, nullptr) == EINTR) {
  }
}

void require_same(const MachineDescription& first, const MachineDescription& other) {
  bool same = first.axes.size() == other.axes.size();
  for (std::size_t i = 0; same && i < first.axes.size(); ++i) {
    same = first.axes[i].name == other.axes[i].name && first.axes[i].rotary == other.axes[i].rotary;
  }
  if (!same) throw std::runtime_error("the recordings to replay have different axes");
  if (std::abs(first.cycle_s - other.cycle_s) > 1e-3 * first.cycle_s) {
    throw std::runtime_error("the recordings to replay have different cycles: " +
                             number(first.cycle_s) + " s and " + number(other.cycle_s) + " s");
  }
}

}  // namespace

ReplaySource::ReplaySource(std::vector<Replay> recordings, double speed)
    : recordings_(std::move(recordings)), speed_(speed) {
  if (recordings_.empty()) throw std::runtime_error("there is no recording to replay");
  for (const Replay& recording : recordings_)
    require_same(recordings_.front().machine(), recording.machine());
}

bool ReplaySource::next() noexcept {
  while (playing_ < recordings_.size()) {
    Replay& recording = recordings_[playing_];
    const double elapsed_s = recording.elapsed_s();
    if (started_ns_ == 0) started_ns_ = steady_ns();
    if (recording.next(next_)) {
      due_ns_ = speed_ > 0.0 ? started_ns_ + std::llround(elapsed_s * 1e9 / speed_) : steady_ns();
      return true;
    }
    ++playing_;
    started_ns_ = 0;
  }
  return false;
}

Received ReplaySource::receive(MachineFrame& frame, double timeout_s) noexcept {
  if (!waits_ && !next()) return Received::kEnd;
  waits_ = true;
  const std::int64_t asked_ns = steady_ns();
  const std::int64_t patience = asked_ns + std::llround(timeout_s * 1e9);
  if (behind_()) {
    while (behind_() && steady_ns() < patience) sleep_until(steady_ns() + kPollPeriod_ns);
    // The rest of the recording is delayed by the same time, so that no burst follows.
    const std::int64_t waited_ns = std::max(steady_ns() - std::max(asked_ns, due_ns_), 0L);
    started_ns_ += waited_ns;
    due_ns_ += waited_ns;
    if (behind_()) return Received::kNothing;
  }
  sleep_until(std::min(due_ns_, patience));
  if (due_ns_ > patience) return Received::kNothing;
  frame = next_;
  waits_ = false;
  return Received::kFrame;
}

std::int64_t ReplaySource::age_ns() const noexcept { return steady_ns() - due_ns_; }

Received DdsSource::receive(MachineFrame& frame, double timeout_s) noexcept {
  const bool came = reader_.receive(frame, timeout_s);
  malformed_.store(reader_.counts().malformed, std::memory_order_relaxed);
  return came && accept(steady_ns()) ? Received::kFrame : Received::kNothing;
}

bool DdsSource::accept(std::int64_t now_ns) noexcept {
  const std::int64_t last_ns = last_ns_.load(std::memory_order_relaxed);
  const bool silent_before = last_ns != 0 && now_ns - last_ns >= kSilence_ns;
  const dds_instance_handle_t writer = reader_.writer();
  if (followed_ != 0 && writer != followed_ && !silent_before && reader_.matched(followed_)) {
    ignored_.fetch_add(1, std::memory_order_relaxed);
    return false;
  }
  followed_ = writer;
  if (silent_before) {
    silence_ns_.store(now_ns - last_ns, std::memory_order_relaxed);
    silences_.fetch_add(1, std::memory_order_release);
  }
  last_ns_.store(now_ns, std::memory_order_relaxed);
  return true;
}

SourceState DdsSource::state(std::int64_t now_ns) const {
  SourceState out;
  out.silent = silent(now_ns);
  out.malformed = malformed_.load(std::memory_order_relaxed);  // for display; orders no data
  return out;
}

bool DdsSource::silent(std::int64_t now_ns) const noexcept {
  const std::int64_t last_ns = last_ns_.load(std::memory_order_relaxed);
  return last_ns != 0 && now_ns - last_ns >= kSilence_ns;
}

std::vector<SourceNews> DdsSource::news(std::int64_t now_ns) {
  std::vector<SourceNews> lines;
  if (const std::uint64_t over = silences_.load(std::memory_order_acquire);
      over != reported_silences_) {
    reported_silences_ = over;
    reported_silent_ = false;
    const auto length_s = static_cast<double>(silence_ns_.load(std::memory_order_relaxed)) * 1e-9;
    lines.push_back(
        {"frames received again after " + number(std::round(10.0 * length_s) / 10.0) + " s", true});
  }
  if (!reported_silent_ && silent(now_ns)) {
    reported_silent_ = true;
    lines.push_back({reader_.matched()
                         ? "frame source silent: no frame for 1 s, but it is still connected"
                         : "frame source stopped: no frame for 1 s"});
  }
  const std::uint64_t ignored = ignored_.load(std::memory_order_relaxed);
  if (ignored != reported_ignored_ &&
      (reported_ignored_ == 0 || now_ns - reported_ignored_ns_ >= kReportPeriod_ns)) {
    lines.push_back({"a second writer sends frames of this machine; ignored: " +
                     counted(ignored - reported_ignored_, "frame")});
    reported_ignored_ = ignored;
    reported_ignored_ns_ = now_ns;
  }
  return lines;
}

std::int64_t DdsSource::age_ns() const noexcept { return wall_ns() - reader_.written_ns(); }

}  // namespace servotwin::daemon
