// A CAN log: a line that is read is a frame that can be, and is written to the same frame again.
#include "drivers/recordings/can_log/can_log.h"

#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  fuzz::refused_or_read([&] {
    CanLogReader reader(fuzz::as_file(data, size));
    CandumpLine line;
    while (reader.next(line)) {
      const CanFrame& frame = line.frame;
      fuzz::require(frame.length <= (frame.fd ? 64 : 8));
      fuzz::require(frame.id < (frame.extended ? kExtendedIds : kStandardIds) || frame.error);
      const CandumpLine again = parse_candump_line(candump_line(frame, line.interface));
      fuzz::require(again.frame.id == frame.id && again.frame.length == frame.length &&
                    again.frame.data == frame.data && again.interface == line.interface);
    }
  });
  return 0;
}
