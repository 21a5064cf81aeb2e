// Two sources as one machine: whatever their stamps, arrivals and losses are, a cycle of the first
// comes at most once and in order, and what the second adds is absent or within what a parabola
// makes of what it sent. That it is added at all, tests/daemon/input/frame_join_test.cpp shows.
//
// Input: events of six bytes: what happens, its value, by how much the stamp goes on [50 us], by
// how much the host's clock does [50 us].
#include <algorithm>
#include <cmath>

#include "daemon/input/frame_join.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  using namespace servotwin::daemon;
  constexpr std::size_t kBytes = 6;
  constexpr std::int64_t kTick_ns = 50'000;
  FrameJoin join({{{0, 0}, {1, 0}}}, {1e-3, 1e-3}, {false, false});
  std::int64_t stamps[2] = {0, 3'600'000'000'000}, now = 1'000'000'000;
  std::uint64_t given = 0, taken = 0;
  double largest = 0.0;
  const auto take = [&] {
    MachineFrame frame;
    while (join.take(frame, now)) {
      fuzz::require(frame.sequence >= taken && frame.sequence < given);
      taken = frame.sequence + 1;
      fuzz::require(frame.axes[0].command == static_cast<double>(frame.sequence));
      // Three samples, the first step at least half as long as the second.
      const double actual = frame.axes[0].actual;
      fuzz::require(std::isnan(actual) || std::abs(actual) <= 4.0 * largest);
      fuzz::require(std::abs(join.clocks().drift) <= 1e-3 && !std::isnan(join.clocks().ahead_s));
    }
  };
  for (std::size_t at = 0; at + kBytes <= size; at += kBytes) {
    const auto signed_of = [&](std::size_t i) {
      return static_cast<std::int16_t>(data[at + i] | data[at + i + 1] << 8);
    };
    const std::size_t stream = data[at] & 1;
    // Most events are many cycles as they should be: the clocks are known after three seconds.
    const int cycles = (data[at] & 2) != 0 ? 1 + 16 * data[at + 1] : 1;
    stamps[stream] += kTick_ns * signed_of(2) * ((data[at] & 4) != 0 ? 1000 : 1);
    now += kTick_ns * std::max<int>(0, signed_of(4));
    for (int k = 0; k < cycles; ++k) {
      const bool both = cycles > 1;
      if (both || stream == 0) {
        MachineFrame frame;
        frame.sequence = given;
        frame.time_ns = stamps[0];
        frame.axis_count = 1;
        frame.axes[0].command = static_cast<double>(given++);
        join.add_first(frame, now);
      }
      if (both || stream == 1) {
        FrameJoin::Sample sample{stamps[1], now, {}};
        sample.axes[0].actual = static_cast<double>(data[at + 1]) - 128.0;
        largest = std::max(largest, std::abs(sample.axes[0].actual));
        join.add_second(sample);
      }
      take();
      if (!both) continue;
      for (std::int64_t& stamp : stamps) stamp += 1'000'000;
      now += 1'000'000;
    }
  }
  now += 1'000'000'000;
  take();
  return 0;
}
