// A trace of a SINUMERIK as XML: as many samples in every channel as stamps, and those in order.
#include "drivers/recordings/sinumerik_trace/sinumerik_trace.h"

#include <algorithm>

#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  ReadOptions options;
  options.columns =
      "C.command=CmdPos2ndEnc64_7[mm],C.actual=measPos2_7[mm],C.torque=ActCurr32_7[A]";
  fuzz::refused_or_read([&] {
    const Recording recording = read_sinumerik_trace(fuzz::as_file(data, size), options);
    fuzz::require(std::is_sorted(recording.time.begin(), recording.time.end()));
    for (const AxisRecord& axis : recording.axes) {
      for (const auto* channel : {&axis.command, &axis.actual, &axis.torque})
        fuzz::require(channel->size() == recording.time.size() || channel->empty());
    }
  });
  return 0;
}
