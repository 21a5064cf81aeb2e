#include <algorithm>
#include <charconv>
#include <cmath>
#include <stdexcept>
#include <string>
#include <vector>

#include "drivers/common/checksum.h"
#include "drivers/common/file_handle.h"
#include "drivers/common/text.h"
#include "drivers/recordings/table/csv.h"

namespace servotwin {
namespace {

struct Written {
  std::string header;
  const std::vector<double>* values = nullptr;
};

bool all_absent(const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isnan(v); });
}

std::vector<Written> columns_of(const Recording& recording) {
  std::vector<Written> columns{{"time[s]", &recording.time}};
  // A recording without values still has its columns.
  const bool nothing =
      std::all_of(recording.axes.begin(), recording.axes.end(), [](const AxisRecord& axis) {
        return all_absent(axis.command) && all_absent(axis.actual) &&
               all_absent(axis.actual_motor) && all_absent(axis.torque);
      });
  const auto add = [&](const std::string& name, const std::string& unit,
                       const std::vector<double>& values) {
    if (nothing ? values.empty() : all_absent(values)) return;
    if (values.size() != recording.time.size()) {
      throw std::invalid_argument(name + " has " + std::to_string(values.size()) + " values for " +
                                  std::to_string(recording.time.size()) + " rows");
    }
    columns.push_back({name + "[" + unit + "]", &values});
  };
  for (const AxisRecord& axis : recording.axes) {
    if (axis.name.empty() || axis.name.find_first_of(",;\t\r\n\"[]#") != std::string::npos) {
      throw std::invalid_argument("the axis name " + in_quotes(axis.name) +
                                  " cannot be used in the header of a recording");
    }
    const std::string position = axis.rotary ? "rad" : "m";
    add(axis.name + ".command", position, axis.command);
    add(axis.name + ".actual", position, axis.actual);
    add(axis.name + ".actual_motor", position, axis.actual_motor);
    if (!axis.torque.empty() && axis.torque_unit.empty()) {
      throw std::invalid_argument(axis.name + ".torque has no unit");
    }
    add(axis.name + ".torque", axis.torque_unit, axis.torque);
  }
  return columns;
}

}  // namespace

void write_recording_csv(const std::filesystem::path& file, const Recording& recording) {
  AtomicFile out(file);
  write_recording_csv(out, recording);
  out.commit();
}

void write_recording_csv(const AtomicFile& out, const Recording& recording) {
  constexpr std::size_t kBlock = 1 << 20, kLongestNumber = 32;
  const std::vector<Written> columns = columns_of(recording);
  std::string text;
  std::uint32_t crc32 = 0;
  const auto write = [&] {
    crc32 = crc32_of(text, crc32);
    out.write(text);
    text.clear();
  };
  for (const Written& column : columns) text += (text.empty() ? "" : ",") + column.header;
  text += '\n';
  for (std::size_t i = 0; i < recording.time.size(); ++i) {
    for (const Written& column : columns) {
      char digits[kLongestNumber];
      // The shortest digits that read back as the same number.
      const auto end = std::to_chars(digits, digits + sizeof digits, (*column.values)[i]);
      text.append(digits, end.ptr);
      text += ',';
    }
    text.back() = '\n';
    if (text.size() >= kBlock) write();
  }
  write();
  out.write(std::string(kChecksumComment) + crc32_text(crc32) + '\n');
}

}  // namespace servotwin
