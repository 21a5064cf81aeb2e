// A machine whose commands come over DDS and whose encoder comes in CAN over UDP, each by a clock
// of its own: real sockets, made motion. The encoder stands where the command is, at the same
// moment, so that whatever lies between them afterwards was made on the way.
#pragma once

#include <time.h>

#include <atomic>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "daemon/between/clock.h"
#include "drivers/can_encoder.h"
#include "drivers/can_map.h"
#include "drivers/can_udp.h"
#include "drivers/dds.h"
#include "drivers/socketcan.h"
#include "twin/sample.h"

namespace servotwin::test {

class TwoClockMachine {
 public:
  static constexpr double kCycle_s = 1e-3;
  static constexpr std::int64_t kAhead_ns =
      3'600'000'000'000;  // what the command's clock shows more
  /// The mapping of the encoder.
  static constexpr const char* kMap =
      "cycle_s = 0.001\n[[bus]]\nname = \"can0\"\n[[axis]]\nname = \"X\"\n"
      "actual = {id = 0x181, start_bit = 0, length = 32, unit = \"um*0.001\"}\n";

  /// 0.2 m/s at most and 1.2 m/s^2.
  static double place(std::int64_t steady_ns) {
    return 0.0333 * std::sin(6.0e-9 * static_cast<double>(steady_ns % 1'000'000'000'000));
  }

  /// Sends to `bus`, "udp:HOST:PORT" or the name of a CAN interface, by a clock that gains `drift`.
  TwoClockMachine(const DdsNode& node, CanMap map, const std::string& bus, double drift)
      : frames_(node), map_(std::move(map)), encoder_(map_), drift_(drift) {
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
    const std::int64_t begin = daemon::steady_ns() + 10'000'000,
                       cycles = std::llround(seconds / kCycle_s);
    std::jthread commands([&] { send_commands(begin, cycles); });
    std::jthread encoder([&] { send_encoder(begin + 370'000, cycles); });
  }
  /// Cycles that began more than half a cycle late, because this host held the sender up.
  [[nodiscard]] std::uint64_t late() const { return late_; }

 private:
  void sleep_until(std::int64_t steady) {
    const timespec until{steady / 1'000'000'000, steady % 1'000'000'000};
    while (clock_nanosleep(daemon::kSteadyClock, TIMER_ABSTIME, &until, nullptr) != 0) {
    }
    if (daemon::steady_ns() - steady > 500'000) ++late_;
  }
  void send_commands(std::int64_t begin, std::int64_t cycles) {
    MachineFrame frame;
    frame.axis_count = 1;
    for (std::int64_t k = 0; k < cycles; ++k) {
      const std::int64_t due = begin + k * 1'000'000;
      frame.sequence = static_cast<std::uint64_t>(k);
      frame.time_ns = due + kAhead_ns;
      frame.axes[0].command = place(due);
      sleep_until(due);
      (void)frames_.write(frame);
    }
  }
  void send_encoder(std::int64_t begin, std::int64_t cycles) {
    std::vector<CanFrame> batch(2);
    for (std::int64_t k = 0; k < cycles; ++k) {
      const std::int64_t due = begin + std::llround(1e6 * static_cast<double>(k) / (1.0 + drift_));
      (void)encoder_.set(0, CanChannel::kActual, place(due));
      batch[0] = encoder_.start();
      batch[1] = encoder_.frame(0);
      sleep_until(due);
      (void)bus_->send(batch);
    }
  }

  DdsWriter<MachineFrame> frames_;
  CanMap map_;
  CanEncoder encoder_;
  std::unique_ptr<CanBus> bus_;
  double drift_;
  std::atomic<std::uint64_t> late_{0};
};

}  // namespace servotwin::test
