// A recording of ROS 2 in an MCAP file: as many samples in every channel as stamps, and those in
// order.
#include "drivers/recordings/mcap/mcap.h"

#include <algorithm>

#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  // By the names of the joints, and by those of the topics.
  for (const char* columns : {"", "X.command=/c:reference.positions.a[m],X.torque=/j:effort.a"}) {
    ReadOptions options;
    options.columns = columns;
    fuzz::refused_or_read([&] {
      const Recording recording = read_mcap(fuzz::as_file(data, size), options);
      fuzz::require(std::is_sorted(recording.time.begin(), recording.time.end()));
      for (const AxisRecord& axis : recording.axes) {
        for (const auto* channel : {&axis.command, &axis.actual, &axis.torque})
          fuzz::require(channel->size() == recording.time.size() || channel->empty());
      }
    });
  }
  return 0;
}
