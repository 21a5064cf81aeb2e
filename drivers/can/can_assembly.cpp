#include "drivers/can/can_assembly.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace servotwin {
namespace {

// A message missing for this long counts as silent, and its positions are unwound anew when it is
// back.
constexpr double kSilence_s = 0.1;
constexpr std::uint64_t kSilentCycles = 10;  // at least
// If several frames share a stamp: the largest distance of the cycles' own clock from the stamps.
constexpr double kMaxHeap_s = 0.25;
constexpr double kClockCorrectionPerCycle = 1e-3;  // share of the difference

std::uint64_t key_of(std::size_t bus, std::uint32_t id, bool extended) noexcept {
  return std::uint64_t{bus} << 32 | std::uint64_t{extended} << 31 | id;
}

/// A counter that one thread writes: relaxed, because no other data depend on it.
void count(std::atomic<std::uint64_t>& counter, std::uint64_t by = 1) noexcept {
  counter.store(counter.load(std::memory_order_relaxed) + by, std::memory_order_relaxed);
}
std::uint64_t read(const std::atomic<std::uint64_t>& counter) noexcept {
  return counter.load(std::memory_order_relaxed);
}

/// `value` on the turn that is nearest to `near`.
double unwound(double value, double turn, double near) noexcept {
  if (!(turn > 0.0) || !std::isfinite(near) || !std::isfinite(value)) return value;
  return value + turn * std::nearbyint((near - value) / turn);
}

}  // namespace

CanAssembly::CanAssembly(CanMap map, Pacing pacing)
    : map_(std::move(map)),
      pacing_(pacing),
      cycle_ns_(std::llround(map_.machine.cycle_s * 1e9)),
      deadline_ns_(std::llround(map_.deadline_s * 1e9)),
      silent_cycles_(std::max(kSilentCycles, static_cast<std::uint64_t>(
                                                 std::llround(kSilence_s / map_.machine.cycle_s)))),
      by_key_(map_.messages.size()),
      signals_of_(map_.messages.size()),
      signal_of_(map_.machine.axes.size()),
      values_(map_.signals.size(), kAbsent),
      messages_(std::make_unique<Message[]>(map_.messages.size())),
      buses_(std::make_unique<Bus[]>(map_.buses.size())),
      axes_(map_.machine.axes.size()) {
  const auto key = [&](std::size_t i) {
    return key_of(map_.messages[i].bus, map_.messages[i].id, map_.messages[i].extended);
  };
  std::iota(by_key_.begin(), by_key_.end(), std::size_t{0});
  std::sort(by_key_.begin(), by_key_.end(),
            [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
  for (const std::size_t message : by_key_) keys_.push_back(key(message));
  for (auto& channels : signal_of_) channels.fill(-1);
  for (std::size_t i = 0; i < map_.signals.size(); ++i) {
    const MappedSignal& signal = map_.signals[i];
    signals_of_[signal.message].push_back(i);
    signal_of_[signal.axis][static_cast<std::size_t>(signal.channel)] = static_cast<int>(i);
  }
  for (const MappedMessage& message : map_.messages) awaited_messages_ += message.from_machine;
}

void CanAssembly::on_frame(std::size_t bus, const CanFrame& frame) noexcept {
  count(buses_[bus].frames);
  lost_ = lost_ || frame.after_gap;
  if (frame.error) {
    on_error_frame(buses_[bus], frame);
    return;
  }
  on_time(frame.time_ns);
  const CycleStart& start = map_.start;
  const bool starts = frame.id == start.id && frame.extended == start.extended && bus == start.bus;
  if (starts && !frame.remote) begin_cycle(frame);
  const std::uint64_t key = key_of(bus, frame.id, frame.extended);
  auto found = std::lower_bound(keys_.begin(), keys_.end(), key);
  if (frame.remote || found == keys_.end() || *found != key) {
    if (!starts || frame.remote) note_unexpected(bus, frame);
    return;
  }
  for (; found != keys_.end() && *found == key; ++found)
    deliver(by_key_[static_cast<std::size_t>(found - keys_.begin())], frame);
}

void CanAssembly::on_time(std::int64_t now_ns) noexcept {
  if (open_ && !emitted_ && now_ns - start_ns_ > deadline_ns_) emit();
}

void CanAssembly::on_clock_set(std::int64_t by_ns) noexcept {
  start_ns_ += by_ns;
  time_ns_ += by_ns;
}

std::optional<std::int64_t> CanAssembly::deadline_ns() const noexcept {
  if (!open_ || emitted_) return std::nullopt;
  return start_ns_ + deadline_ns_;
}

void CanAssembly::on_error_frame(Bus& bus, const CanFrame& frame) noexcept {
  const CanErrors errors = can_errors(frame);
  count(bus.error_frames);
  count(bus.bus_off, errors.bus_off);
  count(bus.restarted, errors.restarted);
  count(bus.passive, errors.passive);
  count(bus.lost_in_controller, errors.lost_in_controller);
  count(bus.not_acknowledged, errors.not_acknowledged);
  count(bus.protocol, errors.protocol);
}

void CanAssembly::note_unexpected(std::size_t bus, const CanFrame& frame) noexcept {
  count(buses_[bus].unexpected);
  // One more than the key, because an empty place is zero.
  const std::uint64_t entry = key_of(bus, frame.id, frame.extended) + 1;
  for (auto& place : unexpected_) {
    if (read(place) == entry) return;
    if (read(place) != 0) continue;
    place.store(entry, std::memory_order_relaxed);
    return;
  }
}

void CanAssembly::begin_cycle(const CanFrame& frame) noexcept {
  end_cycle();
  std::uint64_t cycles = 1;
  const auto cycles_to = [&](std::int64_t from) {
    return static_cast<double>(frame.time_ns - from) / static_cast<double>(cycle_ns_);
  };
  const auto whole = [](double number, double least) {
    return static_cast<std::uint64_t>(std::llround(std::clamp(number, least, 1e12)));
  };
  if (!begun_) {
    time_ns_ = frame.time_ns;
  } else if (pacing_ == Pacing::kByStamp) {
    cycles = whole(cycles_to(start_ns_), 1.0);
    time_ns_ = frame.time_ns;
  } else {
    if (lost_) cycles = whole(cycles_to(time_ns_), 2.0);
    time_ns_ += static_cast<std::int64_t>(cycles) * cycle_ns_;
    const auto off = static_cast<double>(frame.time_ns - time_ns_);
    time_ns_ = std::abs(off) > kMaxHeap_s * 1e9
                   ? frame.time_ns
                   : time_ns_ + std::llround(kClockCorrectionPerCycle * off);
  }
  begun_ = open_ = true;
  emitted_ = lost_ = false;
  sequence_ += cycles;
  start_ns_ = frame.time_ns;
  awaited_ = awaited_messages_;
  for (std::size_t i = 0; i < map_.messages.size(); ++i) messages_[i].arrival = Arrival::kAwaited;
  std::fill(values_.begin(), values_.end(), kAbsent);
}

void CanAssembly::end_cycle() noexcept {
  if (!open_) return;
  if (!emitted_) emit();
  for (std::size_t i = 0; i < map_.messages.size(); ++i) {
    if (!map_.messages[i].from_machine) continue;
    Message& message = messages_[i];
    if (message.arrival != Arrival::kAwaited) {
      message.missing_in_a_row = 0;
      message.silent.store(false, std::memory_order_relaxed);
      continue;
    }
    count(message.missing);
    if (++message.missing_in_a_row == silent_cycles_) {
      count(message.silences);
      message.silent.store(true, std::memory_order_relaxed);
      for (const std::size_t signal : signals_of_[i]) axes_[map_.signals[signal].axis] = {};
    }
  }
  open_ = false;
}

void CanAssembly::deliver(std::size_t index, const CanFrame& frame) noexcept {
  const MappedMessage& mapped = map_.messages[index];
  Message& message = messages_[index];
  const std::span<const std::uint8_t> data(frame.data.data(), frame.length);
  const auto needed = static_cast<std::size_t>(mapped.length);
  // FD frames have few lengths: a message between two of them is padded to the next.
  const bool fits = frame.length == needed || (mapped.at_least && frame.length > needed) ||
                    (frame.fd && frame.length == can_length_at_least(needed, true));
  if (!fits) {
    count(message.wrong_length);
    return;
  }
  if (mapped.selector && raw_bits(mapped.selector->signal, data) != mapped.selector->value) return;
  count(message.received);
  if (!open_ || !mapped.from_machine) return;
  if (message.arrival != Arrival::kAwaited) {
    count(message.repeated);
    return;
  }
  if (emitted_) {
    message.arrival = Arrival::kLate;
    count(message.late);
    return;
  }
  message.arrival = Arrival::kCame;
  for (const std::size_t signal : signals_of_[index])
    values_[signal] = decoded(map_.signals[signal].signal, data);
  if (--awaited_ == 0) emit();
}

double CanAssembly::value_of(std::size_t axis, CanChannel channel) const noexcept {
  const int signal = signal_of_[axis][static_cast<std::size_t>(channel)];
  return signal < 0 ? kAbsent : values_[static_cast<std::size_t>(signal)];
}

AxisSample CanAssembly::sample_of(std::size_t axis) noexcept {
  const auto turn = [&](CanChannel channel) {
    const int signal = signal_of_[axis][static_cast<std::size_t>(channel)];
    return signal < 0 ? 0.0 : map_.signals[static_cast<std::size_t>(signal)].turn;
  };
  Axis& last = axes_[axis];
  AxisSample sample;
  sample.torque = value_of(axis, CanChannel::kTorque);
  sample.command =
      unwound(value_of(axis, CanChannel::kCommand), turn(CanChannel::kCommand), last.command);
  const double near = std::isfinite(sample.command) ? sample.command : last.actual;
  sample.actual = unwound(value_of(axis, CanChannel::kActual), turn(CanChannel::kActual), near);
  if (signal_of_[axis][static_cast<std::size_t>(CanChannel::kCommand)] < 0)
    sample.command = sample.actual + value_of(axis, CanChannel::kFollowingError);
  if (std::isfinite(sample.command)) last.command = sample.command;
  if (std::isfinite(sample.actual)) last.actual = sample.actual;
  return sample;
}

void CanAssembly::emit() noexcept {
  emitted_ = true;
  count(cycles_);
  count(incomplete_, awaited_ > 0);
  if (ready_count_ == ready_.size()) {  // the oldest cycle was not taken
    ready_first_ = (ready_first_ + 1) % ready_.size();
    --ready_count_;
  }
  Cycle& cycle = ready_[(ready_first_ + ready_count_) % ready_.size()];
  ++ready_count_;
  cycle.sequence = sequence_;
  cycle.time_ns = time_ns_;
  for (std::size_t i = 0; i < axes_.size(); ++i) cycle.axes[i] = sample_of(i);
}

bool CanAssembly::take(MachineFrame& frame) noexcept {
  if (ready_count_ == 0) return false;
  const Cycle& cycle = ready_[ready_first_];
  frame.sequence = cycle.sequence;
  frame.time_ns = cycle.time_ns;
  frame.axis_count = static_cast<int>(axes_.size());
  frame.ahead_count = 0;
  frame.axes = cycle.axes;
  ready_first_ = (ready_first_ + 1) % ready_.size();
  --ready_count_;
  return true;
}

CanCounts CanAssembly::counts() const {
  CanCounts out;
  out.cycles = read(cycles_);
  out.incomplete = read(incomplete_);
  for (std::size_t i = 0; i < map_.messages.size(); ++i) {
    const Message& m = messages_[i];
    out.messages.push_back({read(m.received), read(m.late), read(m.missing), read(m.repeated),
                            read(m.wrong_length), read(m.silences),
                            m.silent.load(std::memory_order_relaxed)});
  }
  for (std::size_t i = 0; i < map_.buses.size(); ++i) {
    const Bus& b = buses_[i];
    out.buses.push_back({read(b.frames), read(b.unexpected), read(b.error_frames), read(b.bus_off),
                         read(b.restarted), read(b.passive), read(b.lost_in_controller),
                         read(b.not_acknowledged), read(b.protocol)});
  }
  for (const auto& place : unexpected_) {
    const std::uint64_t entry = read(place);
    if (entry == 0) break;
    const std::uint64_t key = entry - 1;
    out.unexpected.push_back({static_cast<std::size_t>(key >> 32),
                              static_cast<std::uint32_t>(key & (kExtendedIds - 1)),
                              (key >> 31 & 1) != 0});
  }
  return out;
}

}  // namespace servotwin
