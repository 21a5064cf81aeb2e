// A recording as a table or a trace: as many samples in every column as stamps.
#include <array>

#include "drivers/recordings/recording_file.h"
#include "drivers/recordings/sinumerik_capture/sinumerik_capture.h"
#include "drivers/recordings/table/csv.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace servotwin;
  // By the names of the file, and by those of the columns of a foreign one.
  constexpr std::array kColumns{"", "X.command=2[mm],X.actual=3[mm],time=1[s]",
                                "X.command=Soll,X.actual=Ist[um]"};
  for (const char* columns : kColumns) {
    ReadOptions options;
    options.columns = columns;
    fuzz::refused_or_read([&] {
      const auto file = fuzz::as_file(data, size);
      const std::string_view start(reinterpret_cast<const char*>(data), size);
      const Recording recording = is_sinumerik_capture(start)
                                      ? read_sinumerik_capture(file, options)
                                      : read_csv(file, options);
      for (const AxisRecord& axis : recording.axes) {
        fuzz::require(axis.command.size() == recording.time.size() || axis.command.empty());
        fuzz::require(axis.actual.size() == recording.time.size() || axis.actual.empty());
      }
    });
  }
  return 0;
}
