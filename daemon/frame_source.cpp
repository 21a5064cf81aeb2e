#include "daemon/frame_source.h"

#include <time.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <stdexcept>
#include <string>

#include "daemon/clock.h"
#include "drivers/text.h"

namespace servotwin {
namespace {

void sleep_until(std::int64_t steady) noexcept {
  const timespec until{static_cast<time_t>(steady / 1'000'000'000),
                       static_cast<long>(steady % 1'000'000'000)};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) == EINTR) {
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
  const std::int64_t patience = steady_ns() + std::llround(timeout_s * 1e9);
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
  return came ? Received::kFrame : Received::kNothing;
}

std::int64_t DdsSource::age_ns() const noexcept { return wall_ns() - reader_.written_ns(); }

}  // namespace servotwin
