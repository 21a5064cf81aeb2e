// A machine whose commands come over DDS by a clock of their own, and whose encoder comes in CAN
// over UDP or on a CAN bus: real sockets, made motion. The encoder stands where the command is at
// the same moment, so that whatever lies between them afterwards was made on the way.
#pragma once

#include <time.h>

#include <atomic>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/between/clock.h"
#include "drivers/can/can_encoder.h"
#include "drivers/can/can_map.h"
#include "drivers/can/can_udp.h"
#include "drivers/can/socketcan.h"
#include "drivers/dds/dds.h"
#include "twin/sample.h"

namespace servotwin::test {

class TwoClockMachine {
 public:
  static constexpr std::int64_t kAhead_ns = 3'600'000'000'000;  ///< of the clock of the commands
  /// The mapping of the encoder; `cycle_s` as in a file.
  static std::string map_with(const std::string& cycle_s) {
    return "cycle_s = " + cycle_s +
           "\n[[bus]]\nname = \"can0\"\n[[axis]]\nname = \"X\"\n"
           "actual = {id = 0x181, start_bit = 0, length = 32, unit = \"um*0.001\"}\n";
  }

  /// 0.2 m/s at most and 1.2 m/s^2.
  static double place(std::int64_t steady_ns) {
    return 0.0333 * std::sin(6.0e-9 * static_cast<double>(steady_ns % 1'000'000'000'000));
  }

  /// The commands have the cycle of the map. `bus`: "udp:HOST:PORT" or the name of a CAN interface.
  /// `drift`: what the clock of the commands
  /// gains on this host's.
  TwoClockMachine(const DdsNode& node, CanMap map, const std::string& bus, double drift)
      : frames_(node),
        map_(std::move(map)),
        encoder_(map_),
        drift_(drift),
        cycle_ns_(std::llround(1e9 * map_.machine.cycle_s)) {
    if (bus.starts_with("udp:")) {
      bus_ = std::make_unique<CanUdp>(CanUdpPlace{"127.0.0.1:0", bus.substr(4)});
    } else {
      bus_ = std::make_unique<SocketCan>(bus);
    }
  }
  [[nodiscard]] bool wait_for_daemon(double timeout_s) {
    return frames_.wait_for_readers(1, timeout_s);
  }
  void run(double seconds) {
    begin_ns_ = daemon::steady_ns() + 10 * cycle_ns_;
    const std::int64_t cycles = std::llround(seconds / map_.machine.cycle_s);
    std::jthread commands([&] { send_commands(cycles); });
    std::jthread encoder([&] { send_encoder(cycles); });
  }
  /// When the command of a cycle is sent, by the steady clock of this host. Any thread.
  [[nodiscard]] std::int64_t due_ns(std::uint64_t cycle) const {
    const auto by_its_clock = static_cast<double>(cycle_ns_) * static_cast<double>(cycle);
    return begin_ns_ + std::llround(by_its_clock / (1.0 + drift_));
  }
  /// Cycles that began more than half a cycle late, because this host held the sender up.
  [[nodiscard]] std::uint64_t late() const { return late_; }
  /// By how much packets of the encoder were sent later than the time of their value, on average
  /// [s]: they are stamped when they are received.
  [[nodiscard]] double encoder_late_s() const { return encoder_late_s_; }

 private:
  void sleep_until(std::int64_t steady) {
    const timespec until{steady / 1'000'000'000, steady % 1'000'000'000};
    while (clock_nanosleep(daemon::kSteadyClock, TIMER_ABSTIME, &until, nullptr) != 0) {
    }
    if (daemon::steady_ns() - steady > cycle_ns_ / 2) ++late_;
  }
  void send_commands(std::int64_t cycles) {
    MachineFrame frame;
    frame.axis_count = 1;
    for (std::int64_t k = 0; k < cycles; ++k) {
      frame.sequence = static_cast<std::uint64_t>(k);
      frame.time_ns = begin_ns_ + k * cycle_ns_ + kAhead_ns;
      const std::int64_t due = due_ns(frame.sequence);
      frame.axes[0].command = place(due);
      sleep_until(due);
      (void)frames_.write(frame);
    }
  }
  void send_encoder(std::int64_t cycles) {
    std::vector<CanFrame> batch(2);
    for (std::int64_t k = 0; k < cycles; ++k) {
      const std::int64_t due = begin_ns_ + kEncoderLater_ns + k * cycle_ns_;
      (void)encoder_.set(0, CanChannel::kActual, place(due));
      batch[0] = encoder_.start();
      batch[1] = encoder_.frame(0);
      sleep_until(due);
      encoder_late_s_ +=
          1e-9 * static_cast<double>(daemon::steady_ns() - due) / static_cast<double>(cycles);
      (void)bus_->send(batch);
    }
  }
  static constexpr std::int64_t kEncoderLater_ns = 370'000;  // between two commands of any cycle

  DdsWriter<MachineFrame> frames_;
  CanMap map_;
  CanEncoder encoder_;
  std::unique_ptr<CanBus> bus_;
  double drift_;
  std::int64_t cycle_ns_;
  std::atomic<std::int64_t> begin_ns_{0};
  std::atomic<std::uint64_t> late_{0};
  double encoder_late_s_ = 0.0;  // written by one thread, read after it has ended
};

}  // namespace servotwin::test
