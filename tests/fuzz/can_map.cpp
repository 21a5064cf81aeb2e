// A mapping of CAN signals: every problem is a line with its place; what is accepted can be decoded
// from any frame, and has its messages and axes.
#include "drivers/can/can_map.h"

#include <array>

#include "drivers/can/can_frame.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  const CheckedCanMap checked =
      check_can_map(fuzz::text(data, size), "input.toml", SERVOTWIN_FUZZ_SEEDS);
  for (const ConfigProblem& problem : checked.problems)
    fuzz::require(!problem.what.empty() && problem.message().find('\n') == std::string::npos);
  if (!checked.problems.empty()) return 0;
  const CanMap& map = checked.map;
  fuzz::require(!map.machine.axes.empty() && map.machine.axes.size() <= kMaxAxes);
  fuzz::require(!map.buses.empty() && map.start.bus < map.buses.size());
  fuzz::require(map.machine.cycle_s > 0.0 && map.deadline_s > 0.0);
  for (const MappedMessage& message : map.messages) {
    fuzz::require(message.bus < map.buses.size() && message.length >= 0 && message.length <= 64);
    fuzz::require(message.id < (message.extended ? kExtendedIds : kStandardIds));
  }
  std::array<std::uint8_t, 64> frame{};
  frame.fill(0xA5);
  for (const MappedSignal& signal : map.signals) {
    fuzz::require(signal.axis < map.machine.axes.size() && signal.message < map.messages.size());
    const int bytes = bytes_needed(signal.signal);
    fuzz::require(bytes > 0 && bytes <= map.messages[signal.message].length);
    (void)decoded(signal.signal, frame);
  }
  return 0;
}
