#include "daemon/input/can_source.h"

#include <poll.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

#include "daemon/between/clock.h"
#include "daemon/between/report_period.h"
#include "drivers/common/text.h"

namespace servotwin::daemon {
namespace {

constexpr std::size_t kMaxBuses = 8;
// If the offset from the steady clock changes by more than this, the wall clock was set, not
// slewed.
constexpr std::int64_t kClockSet_ns = 2'000'000;
// Allowance for a frame that has its stamp and has not been received yet.
constexpr std::int64_t kReceptionDelay_ns = 100'000;
// How often an interface that is down is checked.
constexpr double kInterfaceCheck_s = 0.1;

}  // namespace

CanSource::CanSource(CanMap map, std::vector<std::unique_ptr<CanBus>> buses, Pacing pacing)
    : assembly_(std::move(map), pacing),
      buses_(std::move(buses)),
      queues_(buses_.size()),
      clock_offset_ns_(wall_ns() - steady_ns()),
      last_cycle_ns_(steady_ns()) {
  const CanMap& known = assembly_.map();
  if (buses_.size() != known.buses.size() || buses_.size() > kMaxBuses) {
    throw std::invalid_argument("the mapping has " + std::to_string(known.buses.size()) +
                                " buses (" + listed(known.buses) + "), and " +
                                std::to_string(buses_.size()) + " are given; at most " +
                                std::to_string(kMaxBuses) + " are possible");
  }
  for (std::size_t i = 0; i < buses_.size(); ++i) {
    if (i != known.start.bus) order_.push_back(i);
  }
  order_.push_back(known.start.bus);
  patience_ns_ = std::max<std::int64_t>(500'000'000, std::llround(known.machine.cycle_s * 1e11));
  reported_ = snapshot();
}

void CanSource::refill(std::size_t bus) noexcept {
  Queue& queue = queues_[bus];
  queue.next = 0;
  queue.count = buses_[bus]->receive(queue.frames, 0.0);
  queue.may_have_more = queue.count == queue.frames.size();
}

int CanSource::oldest() noexcept {
  int found = -1;
  for (const std::size_t bus : order_) {
    Queue& queue = queues_[bus];
    if (queue.next == queue.count && queue.may_have_more) refill(bus);
    if (queue.next == queue.count) continue;
    if (found >= 0) {
      const Queue& other = queues_[static_cast<std::size_t>(found)];
      if (between_ns(other.frames[other.next].time_ns, queue.frames[queue.next].time_ns) >= 0)
        continue;
    }
    found = static_cast<int>(bus);
  }
  return found;
}

void CanSource::follow_clock() noexcept {
  const std::int64_t before = steady_ns();
  const std::int64_t offset = wall_ns() - before;
  // Too much time between the two readings (busy host): the difference proves no step of the clock.
  if (steady_ns() - before > kClockSet_ns / 2) return;
  const std::int64_t step = offset - clock_offset_ns_;
  if (std::abs(step) > kClockSet_ns) assembly_.on_clock_set(step);
  clock_offset_ns_ = offset;
}

void CanSource::wait(double timeout_s) noexcept {
  std::array<pollfd, kMaxBuses> wanted{};
  nfds_t count = 0;
  for (std::size_t i = 0; i < buses_.size(); ++i) {
    const int descriptor = buses_[i]->descriptor();
    if (descriptor >= 0) wanted[count++] = {descriptor, POLLIN, 0};
    if (!buses_[i]->counts().up) timeout_s = std::min(timeout_s, kInterfaceCheck_s);
  }
  const timespec timeout{static_cast<time_t>(timeout_s),
                         static_cast<long>((timeout_s - std::floor(timeout_s)) * 1e9)};
  ppoll(wanted.data(), count, &timeout, nullptr);
  for (const std::size_t bus : order_) refill(bus);
}

Received CanSource::receive(MachineFrame& frame, double timeout_s) noexcept {
  const std::int64_t until = steady_ns() + std::llround(timeout_s * 1e9);
  while (true) {
    if (assembly_.take(frame)) {
      last_cycle_ns_ = steady_ns();
      stalled_.store(false, std::memory_order_relaxed);  // for display; orders no data
      return Received::kFrame;
    }
    if (const int bus = oldest(); bus >= 0) {
      Queue& queue = queues_[static_cast<std::size_t>(bus)];
      const CanFrame& next = queue.frames[queue.next++];
      completed_ns_ = next.time_ns;
      detect_other_sender(static_cast<std::size_t>(bus), next);
      if (prediction_) prediction_->on_frame(static_cast<std::size_t>(bus), next, steady_ns());
      assembly_.on_frame(static_cast<std::size_t>(bus), next);
      continue;
    }
    follow_clock();
    std::int64_t patience = until - steady_ns();
    if (const auto deadline = assembly_.deadline_ns()) {
      const std::int64_t left = between_ns(wall_ns(), *deadline) + kReceptionDelay_ns;
      if (left <= 0) {
        completed_ns_ = *deadline;
        assembly_.on_time(*deadline + 1);
        continue;
      }
      patience = std::min(patience, left);
    }
    const std::int64_t now = steady_ns();
    if (now - last_cycle_ns_ > patience_ns_) stalled_.store(true, std::memory_order_relaxed);
    if (now >= until) return Received::kNothing;
    wait(static_cast<double>(std::max<std::int64_t>(patience, 0)) * 1e-9);
  }
}

void CanSource::carry_offsets(const std::vector<std::size_t>& axes) {
  const CanMap& known = assembly_.map();
  for (const std::size_t axis : axes) {
    CanOffset offset(known, axis);
    const std::size_t message = known.find(axis, CanChannel::kOffset)->message;
    carried_.push_back({axis, message, std::move(offset)});
  }
}

void CanSource::tell_predictions() {
  prediction_.emplace(assembly_.map(), steady_ns(), std::random_device()());
}

void CanSource::tell(const MachinePrediction& prediction) noexcept {
  if (prediction_) prediction_->tell(prediction, buses_, steady_ns());
}

void CanSource::show_alarm(std::size_t axis, bool raised) noexcept {
  if (prediction_) prediction_->alarm(axis, raised);
}

void CanSource::detect_other_sender(std::size_t bus, const CanFrame& frame) noexcept {
  for (const Carried& one : carried_) {
    const MappedMessage& ours = assembly_.map().messages[one.message];
    // A bus never delivers own frames: this one comes from another sender.
    if (ours.bus != bus || ours.id != frame.id || ours.extended != frame.extended) continue;
    other_sender_ns_ = steady_ns();
    if (sent_ns_ && *other_sender_ns_ - *sent_ns_ < kSimultaneous_ns)
      other_sender_.store(static_cast<int>(one.axis), std::memory_order_relaxed);
  }
}

std::uint32_t CanSource::send(const MachineOffset& offset, std::int64_t until_ns) noexcept {
  std::uint32_t kept_back = 0;
  for (Carried& one : carried_) {
    const AxisOffset& axis = offset.axes[one.axis];
    if (!axis.send) continue;
    const std::int64_t now = steady_ns();
    if (other_sender_ns_ && now - *other_sender_ns_ < kSimultaneous_ns)
      other_sender_.store(static_cast<int>(one.axis), std::memory_order_relaxed);
    // The process may have been paused since the offset was made: it belongs to a cycle that is
    // over. relaxed: the flag orders no other data.
    const bool leaves = other_sender_.load(std::memory_order_relaxed) < 0 && now <= until_ns &&
                        one.offset.send(axis, *buses_[assembly_.map().messages[one.message].bus]);
    if (leaves) {
      sent_ns_ = now;
    } else {
      kept_back |= 1U << one.axis;
    }
  }
  return kept_back;
}

std::string CanSource::offsets_held_back() const {
  const int axis = other_sender_.load(std::memory_order_relaxed);
  if (axis < 0) return {};
  return "another sender also sends offsets to the drive of axis " +
         assembly_.map().machine.axes[static_cast<std::size_t>(axis)].name +
         ": this daemon sends none until it is restarted; arm only one of them";
}

std::int64_t CanSource::age_ns() const noexcept { return wall_ns() - completed_ns_; }

SourceState CanSource::state(std::int64_t /*now_ns*/) const {
  // relaxed: for display; orders no data.
  return {stalled_.load(std::memory_order_relaxed), malformed(), buses(), offsets_held_back(), {}};
}

std::uint64_t CanSource::malformed() const noexcept {
  std::uint64_t total = 0;
  for (std::size_t i = 0; i < assembly_.map().messages.size(); ++i)
    total += assembly_.wrong_length(i);
  for (const auto& bus : buses_) total += bus->counts().malformed;
  return total;
}

std::vector<BusStatus> CanSource::buses() const {
  const CanMap& known = assembly_.map();
  const CanCounts counts = assembly_.counts();
  std::vector<BusStatus> out;
  for (std::size_t i = 0; i < buses_.size(); ++i) {
    const CanBusCounts bus = buses_[i]->counts();
    BusStatus status;
    status.name = known.buses[i];
    status.up = bus.up;
    status.frames = bus.received;
    status.dropped = bus.dropped;
    status.packets_lost = bus.lost;
    status.downs = bus.downs;
    status.unexpected = counts.buses[i].unexpected;
    status.error_frames = counts.buses[i].error_frames;
    out.push_back(std::move(status));
  }
  for (std::size_t i = 0; i < counts.messages.size(); ++i) {
    BusStatus& status = out[known.messages[i].bus];
    status.missing += counts.messages[i].missing;
    status.late += counts.messages[i].late;
  }
  return out;
}

CanSource::Snapshot CanSource::snapshot() const {
  Snapshot out;
  out.counts = assembly_.counts();
  for (const auto& bus : buses_) out.buses.push_back(bus->counts());
  out.stalled = stalled_.load(std::memory_order_relaxed);
  out.other_tells = prediction_ && prediction_->heard_other(steady_ns());
  return out;
}

std::vector<SourceNews> CanSource::news(std::int64_t now_ns) {
  const Snapshot now = snapshot();
  bool changed = now.stalled != reported_.stalled || now.other_tells != reported_.other_tells;
  for (std::size_t i = 0; i < buses_.size(); ++i) {
    const CanTrafficCounts& a = reported_.counts.buses[i];
    const CanTrafficCounts& b = now.counts.buses[i];
    changed = changed || (now.buses[i].malformed > 0 && reported_.buses[i].malformed == 0);
    changed = changed || now.buses[i].up != reported_.buses[i].up ||
              now.buses[i].downs != reported_.buses[i].downs || a.bus_off != b.bus_off ||
              a.restarted != b.restarted;
  }
  for (std::size_t i = 0; i < now.counts.messages.size(); ++i) {
    const CanMessageCounts& a = reported_.counts.messages[i];
    const CanMessageCounts& b = now.counts.messages[i];
    changed = changed || a.silent != b.silent || a.silences != b.silences;
  }
  changed = changed || now.counts.unexpected.size() != reported_.counts.unexpected.size();
  if (!changed && reported_ns_ != 0 && now_ns - reported_ns_ < kReportPeriod_ns) return {};

  const CanMap& known = assembly_.map();
  std::vector<SourceNews> lines;
  for (std::size_t i = 0; i < buses_.size(); ++i) {
    const CanBusCounts& a = reported_.buses[i];
    const CanBusCounts& b = now.buses[i];
    const std::string& name = known.buses[i];
    if (b.downs > a.downs) lines.push_back({name + ": the interface went down or was removed"});
    if (b.up && (!a.up || b.downs > a.downs))
      lines.push_back({name + ": the interface is up again", true});
    if (b.dropped > a.dropped) {
      lines.push_back({name + ": " + counted(b.dropped - a.dropped, "frame") +
                       " dropped by the kernel: not read in time"});
    }
    if (b.lost > a.lost)
      lines.push_back({name + ": " + counted(b.lost - a.lost, "packet") + " lost"});
    if (b.malformed > a.malformed) {
      lines.push_back({name + ": " + counted(b.malformed - a.malformed, "packet") +
                       " ignored: not CAN, or not from the peer"});
    }
  }
  if (now.stalled != reported_.stalled) {
    const std::string start =
        can_id_text(known.start.id, known.start.extended) + " on " + known.buses[known.start.bus];
    lines.push_back(now.stalled ? SourceNews{"no cycle starts: " + start + " is not received"}
                                : SourceNews{"cycles start again with " + start, true});
  }
  if (now.other_tells != reported_.other_tells) {
    lines.push_back(
        now.other_tells
            ? SourceNews{"another sender tells the PLC predictions: this daemon sends none while "
                         "it does"}
            : SourceNews{"the other sender of predictions is silent: this daemon sends them",
                         true});
  }
  for (SourceNews& line : happened(known, reported_.counts, now.counts))
    lines.push_back(std::move(line));
  // The minute starts with the last report.
  if (!lines.empty()) reported_ns_ = now_ns;
  reported_ = now;
  return lines;
}

}  // namespace servotwin::daemon
