// A machine on a CAN bus: every cycle of a mapping, at its rate, for so long.
//
//   bench_can MAP SECONDS INTERFACE        on an interface, frame by frame
//   bench_can MAP SECONDS udp:HOST:PORT    in cannelloni's format, a packet per cycle
//
// The axes repeat the bench's record (tests/bench/record.h), each somewhere else in it. SYNC first,
// then all messages of the cycle in one go. Prints one JSON object: what was sent, what the bus
// refused, how many cycles began more than half a cycle late because this host held the sender up.
// `can` starts the daemon and compares.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "daemon/between/clock.h"
#include "daemon/loop/scheduling.h"
#include "drivers/can/can_encoder.h"
#include "drivers/can/can_udp.h"
#include "drivers/can/socketcan.h"
#include "tests/bench/record.h"

namespace {

using namespace servotwin;

// Above what else there is, and below the daemon: on one processor a sender that has fallen behind
// must not hold up its twin, as no real machine does.
constexpr int kPriority = 70;

void sleep_until(std::int64_t steady) {
  const timespec until{steady / 1'000'000'000, steady % 1'000'000'000};
  while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, nullptr) != 0) {
  }
}

/// The frames of one cycle, SYNC first.
class Machine {
 public:
  explicit Machine(const CanMap& map) : map_(map), encoder_(map) {
    frames_.reserve(map.messages.size() + 1);
  }
  const std::vector<CanFrame>& cycle(std::int64_t cycle) {
    for (std::size_t axis = 0; axis < map_.machine.axes.size(); ++axis) {
      const auto row = static_cast<Eigen::Index>(cycle + 1357 * static_cast<std::int64_t>(axis)) %
                       record_.size();
      const double command = record_.command(row), actual = record_.actual(row);
      encoder_.set(axis, CanChannel::kCommand, command);
      encoder_.set(axis, CanChannel::kActual, actual);
      encoder_.set(axis, CanChannel::kFollowingError, command - actual);
      encoder_.set(axis, CanChannel::kTorque, 12.5);
      encoder_.set(axis, CanChannel::kStatusWord, 0x1237);
      encoder_.set(axis, CanChannel::kControlWord, 0x000F);
    }
    frames_.assign(1, encoder_.start());
    for (std::size_t i = 0; i < map_.messages.size(); ++i) frames_.push_back(encoder_.frame(i));
    return frames_;
  }

 private:
  const CanMap& map_;
  CanEncoder encoder_;
  Segment record_ = bench::production_record();
  std::vector<CanFrame> frames_;
};

nlohmann::json run(const std::string& map_file, double seconds, const std::string& place) {
  const CanMap map = load_can_map(map_file);
  std::unique_ptr<CanBus> bus;
  if (place.starts_with("udp:")) {
    bus = std::make_unique<CanUdp>(CanUdpPlace{"127.0.0.1:0", place.substr(4)});
  } else {
    bus = std::make_unique<SocketCan>(place);
  }
  Machine machine(map);
  const std::string refused_priority = daemon::become_real_time(kPriority);
  const auto cycle_ns = std::llround(1e9 * map.machine.cycle_s);
  const auto cycles = std::llround(seconds / map.machine.cycle_s);
  std::uint64_t frames = 0, sent = 0, late = 0;
  std::int64_t latest_ns = 0;
  const std::int64_t begin = daemon::steady_ns() + cycle_ns;
  for (std::int64_t k = 0; k < cycles; ++k) {
    const std::vector<CanFrame>& batch = machine.cycle(k);
    const std::int64_t due = begin + k * cycle_ns;
    sleep_until(due);
    const std::int64_t behind = daemon::steady_ns() - due;
    late += behind > cycle_ns / 2;
    latest_ns = std::max(latest_ns, behind);
    frames += batch.size();
    sent += bus->send(batch);
  }
  return {{"cycles", cycles},
          {"frames", sent},
          {"refused", frames - sent},
          {"late_cycles", late},
          {"latest_ms", 1e-6 * static_cast<double>(latest_ns)},
          {"priority", refused_priority}};
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 4) {
    std::fprintf(stderr, "usage: bench_can MAP SECONDS INTERFACE|udp:HOST:PORT\n");
    return 2;
  }
  try {
    std::printf("%s\n", run(argv[1], std::atof(argv[2]), argv[3]).dump().c_str());
    return 0;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "bench_can: %s\n", error.what());
    return 1;
  }
}
