#include "tests/virtual_machine/recording.h"

#include <array>
#include <charconv>
#include <stdexcept>
#include <string_view>

namespace servotwin::virtual_machine {
namespace {

constexpr double kMillimetres = 1e3;  // per metre

void append(std::string& line, double value, int decimals) {
  std::array<char, 64> digits{};
  const auto end = std::to_chars(digits.data(), digits.data() + digits.size(), value,
                                 std::chars_format::fixed, decimals);
  if (end.ec != std::errc())
    throw std::invalid_argument("recording: a value is too long to be written");
  std::string_view text(digits.data(), static_cast<std::size_t>(end.ptr - digits.data()));
  if (text.find_first_not_of("-0.") == std::string_view::npos && text.front() == '-') {
    text.remove_prefix(1);  // no minus zero
  }
  line += text;
}

}  // namespace

void write_csv(const std::vector<AxisRecord>& axes, const CsvFormat& format, std::ostream& out) {
  if (axes.empty()) throw std::invalid_argument("recording: there is no axis");
  for (const AxisRecord& axis : axes) {
    if (axis.command.size() != axes.front().command.size() ||
        axis.sample_time != axes.front().sample_time) {
      throw std::invalid_argument("recording: axis " + axis.name +
                                  " differs from the first in length or sampling time");
    }
  }
  for (const std::string& comment : format.comments) out << "# " << comment << '\n';
  std::string line = "time[s]";
  for (const AxisRecord& axis : axes) {
    line += ',' + axis.name + ".command[mm]," + axis.name + ".actual[mm]," + axis.name +
            ".torque[" + format.torque_unit + ']';
  }
  out << line << '\n';
  for (Eigen::Index n = 0; n < axes.front().command.size(); ++n) {
    line.clear();
    append(line, static_cast<double>(n) * axes.front().sample_time, format.time_decimals);
    for (const AxisRecord& axis : axes) {
      line += ',';
      append(line, kMillimetres * axis.command[n], format.command_decimals);
      line += ',';
      append(line, kMillimetres * axis.actual[n], format.actual_decimals);
      line += ',';
      append(line, axis.torque[n], format.torque_decimals);
    }
    line += '\n';
    out << line;
  }
}

}  // namespace servotwin::virtual_machine
