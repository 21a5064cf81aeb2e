#include "cli/live/can_replay.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <thread>

#include "cli/common/command.h"
#include "cli/common/interrupt.h"
#include "cli/common/output.h"
#include "daemon/between/clock.h"
#include "daemon/input/frame_source.h"
#include "daemon/input/recorded_cycles.h"
#include "drivers/can/can_encoder.h"
#include "drivers/can/can_udp.h"
#include "drivers/can/socketcan.h"
#include "drivers/common/text.h"
#include "drivers/recordings/can_log/can_log.h"
#include "drivers/recordings/can_log/can_recording.h"

namespace servotwin::cli {
namespace {

constexpr double kBusPatience_s = 0.2;  // longest delay of an interrupt
constexpr double kLate_s = 1e-3;  // a frame of a log that is sent later than this counts as late
// After a delay, the cycles of a recording catch up with at least this share of the cycle time
// between them: drives need time to answer, and a bus has a limited bit rate.
constexpr double kMinCatchUpCycle = 0.9;
constexpr std::uint16_t kOperationEnabled = 0x1237;  // status word of a drive in operation

using Buses = std::vector<std::unique_ptr<CanBus>>;

Buses opened(const CanReplayOptions& options) {
  Buses buses;
  if (!options.udp.empty()) {
    buses.push_back(std::make_unique<CanUdp>(CanUdpPlace{"0.0.0.0:0", options.udp}));
  }
  for (const std::string& interface : options.interfaces)
    buses.push_back(std::make_unique<SocketCan>(interface));
  return buses;
}

struct Sent {
  std::uint64_t frames = 0, refused = 0, late = 0;
};

void send(CanBus& bus, std::span<const CanFrame> frames, Sent& sent) {
  for (const CanFrame& frame : frames) {
    // The queue of an interface is short; when it is full, the frame is sent again a little later.
    bool gone = bus.send({&frame, 1}) == 1;
    for (int again = 0; again < 20 && !gone; ++again) {
      std::this_thread::sleep_for(std::chrono::microseconds(200));
      gone = bus.send({&frame, 1}) == 1;
    }
    ++(gone ? sent.frames : sent.refused);
  }
}

void report(const Sent& sent, double seconds) {
  say(stdout, "sent " + counted(sent.frames, "frame") +
                  text(" in %.2f s, %zu late", seconds, static_cast<std::size_t>(sent.late)));
  if (sent.refused > 0) {
    throw std::runtime_error(
        "the bus refused " + counted(sent.refused, "frame") +
        ": is it up, does another node acknowledge, and does it support CAN FD?");
  }
}

void sleep_until(std::int64_t steady) {
  const std::int64_t left = steady - daemon::steady_ns();
  if (left > 0) std::this_thread::sleep_for(std::chrono::nanoseconds(left));
}

/// The place of a name in a list; appends the name if it is not in the list.
std::size_t place_of(const std::string& name, std::vector<std::string>& names) {
  const auto found = std::find(names.begin(), names.end(), name);
  const auto place = static_cast<std::size_t>(found - names.begin());
  if (found == names.end()) names.push_back(name);
  return place;
}

void play_log(const CanReplayOptions& options, Buses& buses) {
  CanLogReader reader(options.file, named_can_log(options.read));
  std::vector<std::string> interfaces;
  CandumpLine line;
  Sent sent;
  std::uint64_t errors = 0;
  const Interrupt interrupt;
  const Progress progress("replaying " + options.file.filename().string());
  const std::int64_t begin = daemon::steady_ns();
  std::int64_t first_ns = 0;
  for (bool first = true; !interrupt.came() && reader.next(line); first = false) {
    if (first) first_ns = line.frame.time_ns;
    const std::size_t bus = place_of(line.interface, interfaces);
    if (bus >= buses.size()) {
      throw std::runtime_error(options.file.string() + ": has frames of " + listed(interfaces) +
                               "; name one interface for each of them with --can A,B");
    }
    if (line.frame.error) {  // made by an interface, not a frame of the bus: it cannot be sent
      ++errors;
      continue;
    }
    const double after_s = 1e-9 * static_cast<double>(line.frame.time_ns - first_ns);
    const std::int64_t due = begin + std::llround(1e9 * after_s / options.speed);
    while (!interrupt.came() && daemon::steady_ns() < due) {
      std::this_thread::sleep_for(std::chrono::nanoseconds(
          std::min<std::int64_t>(due - daemon::steady_ns(), std::llround(kBusPatience_s * 1e9))));
    }
    if (static_cast<double>(daemon::steady_ns() - due) > kLate_s * 1e9) ++sent.late;
    send(*buses[bus], {&line.frame, 1}, sent);
  }
  for (const std::string& note : reader.notes()) say(stdout, "note: " + note);
  if (errors > 0) say(stdout, "note: " + counted(errors, "error frame") + " not sent");
  report(sent, 1e-9 * static_cast<double>(daemon::steady_ns() - begin));
}

/// Puts the cycles of a recording into the frames of a mapping.
class CycleSender {
 public:
  CycleSender(const CanMap& map, const MachineDescription& machine, bool targets, Buses& buses)
      : encoder_(map), targets_(targets), buses_(buses) {
    for (std::size_t i = 0; i < map.machine.axes.size(); ++i) {
      const AxisDescription& axis = map.machine.axes[i];
      const auto found =
          std::find_if(machine.axes.begin(), machine.axes.end(), [&](const AxisDescription& one) {
            return one.name == axis.name && one.rotary == axis.rotary;
          });
      if (found == machine.axes.end()) {
        throw std::runtime_error("the mapping has axis " + in_quotes(axis.name) + " in " +
                                 (axis.rotary ? "rad" : "m") +
                                 ", which the recording does not have");
      }
      columns_.push_back(static_cast<std::size_t>(found - machine.axes.begin()));
      if (targets && map.find(i, CanChannel::kTarget) == nullptr)
        throw std::runtime_error("axis " + in_quotes(axis.name) + " has no target in the mapping");
    }
  }

  void send_cycle(const MachineFrame& frame, Sent& sent) {
    for (std::size_t i = 0; i < columns_.size(); ++i) set(i, frame.axes[columns_[i]]);
    const CanMap& map = encoder_.map();
    // The controller's targets take effect with the SYNC that follows them.
    if (!targets_) begin(sent);
    for (std::size_t i = 0; i < map.messages.size(); ++i) {
      const bool ours =
          targets_ ? encoder_.carries(i, CanChannel::kTarget) ||
                         encoder_.carries(i, CanChannel::kControlWord)
                   : map.messages[i].from_machine || encoder_.carries(i, CanChannel::kStatusWord);
      if (ours) send(*buses_[map.messages[i].bus], {&encoder_.frame(i), 1}, sent);
    }
    if (targets_) begin(sent);
    enabling_ = std::min(enabling_ + 1, 2);
  }
  [[nodiscard]] std::uint64_t not_carried() const { return not_carried_; }

 private:
  void begin(Sent& sent) {
    const CanMap& map = encoder_.map();
    const bool a_message =
        std::any_of(map.messages.begin(), map.messages.end(), [&](const MappedMessage& message) {
          return message.bus == map.start.bus && message.id == map.start.id &&
                 message.extended == map.start.extended;
        });
    const CanFrame start = encoder_.start();
    if (!a_message) send(*buses_[map.start.bus], {&start, 1}, sent);
  }
  void set(std::size_t axis, const AxisSample& sample) {
    const auto put = [&](CanChannel channel, double value) {
      if (encoder_.map().find(axis, channel) != nullptr && !encoder_.set(axis, channel, value))
        ++not_carried_;
    };
    if (targets_) {
      put(CanChannel::kTarget, sample.command);
      constexpr std::array<double, 3> kEnable{0x06, 0x07, 0x0F};
      put(CanChannel::kControlWord, kEnable[static_cast<std::size_t>(enabling_)]);
      return;
    }
    put(CanChannel::kCommand, sample.command);
    put(CanChannel::kActual, sample.actual);
    put(CanChannel::kTorque, std::isfinite(sample.torque) ? sample.torque : 0.0);
    put(CanChannel::kFollowingError, sample.command - sample.actual);
    put(CanChannel::kStatusWord, kOperationEnabled);
  }

  CanEncoder encoder_;
  bool targets_;
  Buses& buses_;
  std::vector<std::size_t> columns_;  // of the recording, by axis of the mapping
  int enabling_ = 0;
  std::uint64_t not_carried_ = 0;
};

void play_recording(const CanReplayOptions& options, const CanMap& map, Buses& buses) {
  ReadOptions read = options.read;
  read.can_map.clear();
  daemon::RecordedCycles cycles = daemon::recorded_cycles(read_recording(options.file, read));
  for (const std::string& note : cycles.recording.notes) say(stdout, "note: " + note);
  for (const std::string& note : cycles.notes) say(stdout, "note: " + note);
  const double cycle_s = cycles.cycle_s;
  if (std::abs(cycle_s * options.speed - map.machine.cycle_s * options.speed) >
      1e-3 * map.machine.cycle_s) {
    throw std::runtime_error(
        text("the recording has a cycle of %.6g ms and the mapping one of "
             "%.6g ms; set cycle_s in the mapping",
             1e3 * cycle_s, 1e3 * map.machine.cycle_s));
  }
  std::vector<Replay> replays;
  replays.emplace_back(std::move(cycles.recording), cycle_s);
  const std::size_t rows = replays.front().rows();
  CycleSender sender(map, replays.front().machine(), options.targets, buses);
  daemon::ReplaySource machine(std::move(replays), options.speed);
  Sent sent;
  const Interrupt interrupt;
  const Progress progress(text("replaying %s, %.0f s", options.file.filename().c_str(),
                               static_cast<double>(rows) * cycle_s / options.speed));
  const std::int64_t begin = daemon::steady_ns();
  MachineFrame frame;
  daemon::Received received = daemon::Received::kNothing;
  std::int64_t earliest = begin;
  while (!interrupt.came() &&
         (received = machine.receive(frame, kBusPatience_s)) != daemon::Received::kEnd) {
    if (received == daemon::Received::kNothing) continue;
    if (static_cast<double>(machine.age_ns()) * 1e-9 > cycle_s / options.speed) ++sent.late;
    sleep_until(earliest);
    earliest = daemon::steady_ns() + std::llround(1e9 * kMinCatchUpCycle * cycle_s / options.speed);
    sender.send_cycle(frame, sent);
  }
  if (sender.not_carried() > 0) {
    say(stdout, "note: in place of " + counted(sender.not_carried(), "value") +
                    " that did not fit into the bits, or were missing, the previous ones were "
                    "sent again");
  }
  report(sent, 1e-9 * static_cast<double>(daemon::steady_ns() - begin));
}

}  // namespace

void replay_onto_can(const CanReplayOptions& options) {
  if (!options.udp.empty() && !options.interfaces.empty())
    throw UsageError("choose one bus: --can or --udp");
  if (options.read.format ? named_can_log(options.read).has_value() : is_can_log(options.file)) {
    if (options.targets) throw UsageError("--targets is for recordings; a log is sent as it is");
    Buses buses = opened(options);
    play_log(options, buses);
    return;
  }
  if (options.read.can_map.empty()) {
    throw UsageError(options.file.string() +
                     ": --can-map F.toml is required: it maps signals to the bits of frames");
  }
  const CanMap map = load_can_map(options.read.can_map);
  Buses buses = opened(options);
  if (buses.size() != map.buses.size()) {
    throw UsageError(text("the mapping has %zu buses (%s), but %zu are given", map.buses.size(),
                          listed(map.buses).c_str(), buses.size()));
  }
  play_recording(options, map, buses);
}

}  // namespace servotwin::cli
