// A recording as CSV: as many samples in every column as stamps.
#include "drivers/csv.h"
#include "drivers/recording_file.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  fuzz::refused_or_read([&] {
    const Recording recording = read_csv(fuzz::as_file(data, size), {});
    for (const AxisRecord& axis : recording.axes) {
      fuzz::require(axis.command.size() == recording.time.size() || axis.command.empty());
      fuzz::require(axis.actual.size() == recording.time.size() || axis.actual.empty());
    }
  });
  return 0;
}
