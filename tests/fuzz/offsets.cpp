// Live offsets between the real-time loop and a drive: whatever happens to frames, processes and
// clocks, the motor feels neither a jump nor more than the peak.
//
// Input: one byte that chooses the kind of drive, then incidents of four bytes:
// what happens, how large (two bytes), how many cycles later.
#include "tests/daemon/loop/offset_world.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin::daemon;
  using Event = OffsetWorld::Event;
  constexpr std::size_t kMaxIncidents = 16, kBytes = 4;
  if (size < 1 + kBytes || size > 1 + kMaxIncidents * kBytes) return 0;
  OffsetWorld world(OffsetWorld::kAllDrives[data[0] % OffsetWorld::kDrives]);
  const auto run = [&](int cycles) {
    for (int k = 0; k < cycles; ++k) servotwin::fuzz::require(world.cycle() == nullptr);
  };
  run(3 * OffsetWorld::kPeriod);
  for (std::size_t at = 1; at + kBytes <= size; at += kBytes) {
    const auto what = static_cast<Event>(data[at] % OffsetWorld::kEvents);
    const int large = data[at + 1] | data[at + 2] << 8;
    const bool clock = what == Event::kFrameClock || what == Event::kHostClock;
    world.happens(what, clock ? large - 32768 : 1 + large % 400);
    run(data[at + 3]);
  }
  run(2 * OffsetWorld::kPeriod);
  return 0;
}
