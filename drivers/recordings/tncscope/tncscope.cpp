#include "drivers/recordings/tncscope/tncscope.h"

#include <algorithm>
#include <array>
#include <map>
#include <string>
#include <utility>

#include "drivers/common/text.h"
#include "drivers/common/units.h"
#include "drivers/recordings/trace_header.h"

namespace servotwin {
namespace {

constexpr std::size_t kMostCurves = 256;  // TNCscope records some tens

constexpr std::array<std::string_view, 5> kKeys{"NAME", "CHANNELTYPE", "AXISTYPE", "DIMENSION",
                                                "COLUMN"};  // of a curve

using CurveSection = std::map<std::string, std::string, std::less<>>;

std::string value_of(const CurveSection& section, std::string_view key) {
  const auto found = section.find(key);
  return found == section.end() ? std::string() : found->second;
}

std::string channel_of_curve(const std::string& type) {
  constexpr std::array<std::pair<std::string_view, const char*>, 6> kChannels{
      {{"s soll", "command"},
       {"s nominal", "command"},
       {"s ist", "actual"},
       {"s actual", "actual"},
       {"I ist", "torque"},
       {"I actual", "torque"}}};
  for (const auto& [theirs, ours] : kChannels) {
    if (theirs == type) return ours;
  }
  return {};
}

std::string unit_of_curve(const std::string& dimension) {
  if (dimension == "Ampere") return "A";
  if (dimension == "Grad" || dimension == "degree" || dimension == "\xb0" ||
      dimension == "\xc2\xb0")
    return "deg";
  return dimension;
}

/// The curve of a section becomes the name of its column.
void add_curve(TextLines& lines, const CurveSection& section, std::vector<std::string>& names) {
  const std::string place = value_of(section, "COLUMN");
  if (place.empty()) return;  // a section of something else
  std::size_t column = 0;
  for (const char c : place) {
    if (c < '0' || c > '9' || column > kMostCurves)
      lines.fail("TNCscope: COLUMN=" + in_quotes(place) + " is no column");
    column = 10 * column + static_cast<std::size_t>(c - '0');
  }
  if (column == 0 || column > kMostCurves)
    lines.fail("TNCscope: COLUMN=" + place + " is not between 1 and " +
               std::to_string(kMostCurves));
  if (names.size() <= column) names.resize(column + 1);
  const std::string axis = value_of(section, "AXISTYPE"),
                    channel = channel_of_curve(value_of(section, "CHANNELTYPE"));
  const std::string unit = unit_of_curve(value_of(section, "DIMENSION"));
  names[column] = axis.empty() || channel.empty() || !parse_unit(unit)
                      ? value_of(section, "NAME")
                      : column_name(axis + "." + channel, unit);
}

}  // namespace

CsvHeader read_tncscope_header(TextLines& lines) {
  CsvHeader header;
  header.separator = ';';
  header.names = {"time[us]"};
  CurveSection section;
  std::string_view line;
  while (lines.next(line)) {
    line = trimmed(line);
    if (!line.starts_with('%')) lines.fail("TNCscope: " + in_quotes(line) + " before %[DATA]");
    line.remove_prefix(1);
    if (line.starts_with('[')) {
      add_curve(lines, section, header.names);
      section.clear();
      if (line == "[DATA]") {
        header.notes.emplace_back("TNCscope recording");
        return header;
      }
      continue;
    }
    const std::size_t equals = line.find('=');
    if (equals == std::string_view::npos) continue;
    const std::string_view key = trimmed(line.substr(0, equals));
    if (std::find(kKeys.begin(), kKeys.end(), key) != kKeys.end())
      section[std::string(key)] = std::string(trimmed(line.substr(equals + 1)));
  }
  lines.fail("TNCscope: there is no %[DATA]");
}

}  // namespace servotwin
