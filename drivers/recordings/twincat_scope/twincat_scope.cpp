#include "drivers/recordings/twincat_scope/twincat_scope.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/common/text.h"
#include "drivers/common/units.h"
#include "drivers/recordings/trace_header.h"
#include "twin/sample.h"

namespace servotwin {
namespace {

constexpr std::string_view kName = "Name", kUnit = "Unit", kSampleTime = "SampleTime[ms]";
constexpr int kMostHeaderLines = 60;  // real ones have twenty

/// "X.SetPos" in a known unit is "X.command[mm]"; other signals keep their names.
std::string signal_name(const std::string& name, const std::string& unit) {
  constexpr std::array<std::pair<std::string_view, const char*>, 2> kChannels{
      {{".SetPos", ".command"}, {".ActPos", ".actual"}}};
  for (const auto& [theirs, ours] : kChannels) {
    if (parse_unit(unit) && name.size() > theirs.size() && name.ends_with(theirs))
      return column_name(name.substr(0, name.size() - theirs.size()) + ours, unit);
  }
  return column_name(name, unit);
}

/// "V (Voltage)" is V, "(None)" nothing.
std::string unit_of_signal(const std::string& cell) {
  return cell.starts_with('(') ? std::string() : cell.substr(0, cell.find(' '));
}

std::optional<double> number_in(std::string cell) {
  std::replace(cell.begin(), cell.end(), ',', '.');
  double value = 0.0;
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  if (error != std::errc() || end != cell.data() + cell.size()) return std::nullopt;
  return value;
}

/// The properties of the channels, each a row of cells.
struct Properties {
  std::vector<std::string> names, units, sample_times;
  std::vector<std::vector<std::string>> scales, offsets;
};

Properties read_properties(TextLines& lines, char separator) {
  Properties out;
  std::string_view line;
  for (int count = 0; count < kMostHeaderLines && lines.next(line); ++count) {
    // A spreadsheet that saves the file again leaves the separators.
    if (line.find_first_not_of(std::string{' ', separator}) == std::string_view::npos) {
      if (out.names.empty()) continue;  // between the recording and its channels
      return out;
    }
    std::vector<std::string> cells = fields_of(line, separator);
    if (cells.front() == kName && out.names.empty() && count > 0)
      out.names = std::move(cells);
    else if (cells.front() == kUnit)
      out.units = std::move(cells);
    else if (cells.front() == kSampleTime)
      out.sample_times = std::move(cells);
    else if (cells.front() == "ScaleFactor" || cells.front() == "Unit ScaleFactor")
      out.scales.push_back(std::move(cells));
    else if (cells.front() == "Offset" || cells.front() == "Unit Offset")
      out.offsets.push_back(std::move(cells));
  }
  lines.fail("TwinCAT Scope: no line Name with the channels, or no empty line behind them");
}

}  // namespace

bool is_twincat_scope(TextLines& lines, const std::string& first) {
  if (!first.starts_with(kName) || first.size() <= kName.size() ||
      std::string_view(";\t:, ").find(first[kName.size()]) == std::string_view::npos)
    return false;
  std::string_view second;
  if (!lines.next(second)) return false;
  const bool is = second.starts_with(std::string("File") + first[kName.size()]);
  lines.put_back();
  return is;
}

CsvHeader read_twincat_scope_header(TextLines& lines, std::string_view first) {
  CsvHeader header;
  header.separator = first[kName.size()];
  if (header.separator == ' ')
    lines.fail("TwinCAT Scope: names may have blanks; export it with another separator");
  Properties channels = read_properties(lines, header.separator);
  if (channels.names.size() > 1 && channels.names.back().empty()) channels.names.pop_back();
  // A file that was not written by the program itself may name the times of the first channel only.
  std::string_view line;
  if (!lines.next(line)) lines.fail("TwinCAT Scope: there are no rows");
  std::vector<std::string> first_row = fields_of(line, header.separator);
  lines.put_back();
  if (first_row.size() > channels.names.size() && first_row.back().empty()) first_row.pop_back();
  const bool each =
      first_row.size() == 2 * (channels.names.size() - 1) && channels.names.size() > 2;
  std::size_t time = 0;
  const auto add = [&](const std::string& name, double step_ms, const std::string& remark) {
    header.names.push_back(name);
    header.time_of.push_back(time);
    header.step_ms.push_back(step_ms);
    header.begins_ms.push_back(
        time < first_row.size() ? number_in(first_row[time]).value_or(kAbsent) : kAbsent);
    header.remarks.push_back(remark);
  };
  for (std::size_t i = 0; i < channels.names.size(); ++i) {
    const auto cell = [i](const std::vector<std::string>& row) {
      return i < row.size() ? row[i] : std::string();
    };
    const std::string& name = channels.names[i];
    if (name == kName || (each && i > 1)) {
      time = header.names.size();
      add("", kAbsent, "");
    }
    if (name == kName) continue;
    const auto differs = [i](const std::vector<std::vector<std::string>>& rows, double from) {
      return std::any_of(rows.begin(), rows.end(), [&](const std::vector<std::string>& cells) {
        return i < cells.size() && number_in(cells[i]).value_or(from) != from;
      });
    };
    const bool scaled = differs(channels.scales, 1.0) || differs(channels.offsets, 0.0);
    add(signal_name(name, unit_of_signal(cell(channels.units))),
        number_in(cell(channels.sample_times)).value_or(kAbsent),
        scaled ? "has a scale factor or an offset, and the file does not say whether its values "
                 "contain them; a unit such as [mm*-1] applies a factor"
               : "");
  }
  header.ends_with = "EOF";
  header.notes.emplace_back("TwinCAT Scope recording");
  return header;
}

}  // namespace servotwin
