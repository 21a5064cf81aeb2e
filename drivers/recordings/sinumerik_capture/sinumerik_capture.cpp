#include "drivers/recordings/sinumerik_capture/sinumerik_capture.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "drivers/common/file_handle.h"
#include "drivers/common/text.h"
#include "drivers/recordings/column_map.h"

namespace servotwin {
namespace {

using nlohmann::json;

// The whole text is held in memory, and some times its size while it is parsed.
constexpr std::size_t kMostBytes = std::size_t{128} << 20;

/// The name of the column of a signal: "Y1.command[mm]", or the signal's own.
std::string column_of(const json& signal) {
  constexpr std::array<std::pair<std::string_view, const char*>, 3> kChannels{
      {{"DES_POS", ".command"}, {"ENC_POS", ".actual"}, {"TORQUE", ".torque"}}};
  std::string name = in_one_line(signal.at("Name").get<std::string>());
  const std::string axis = in_one_line(signal.value("Axis", ""));
  if (axis.empty()) return name;
  const std::string kind = name.substr(0, name.find('|'));
  // A, B2, C1; but AX1 is a linear axis.
  const bool rotary = std::string_view("ABC").find(axis.front()) != std::string_view::npos &&
                      axis.find_first_not_of("0123456789", 1) == std::string::npos;
  for (const auto& [theirs, ours] : kChannels) {
    if (theirs == kind)
      return axis + ours + (theirs == "TORQUE" ? "[Nm]" : rotary ? "[deg]" : "[mm]");
  }
  return name;
}

/// A value of a row; null and text are missing.
double value_in(const json& row, std::size_t at) {
  return at < row.size() && row[at].is_number() ? row[at].get<double>() : kAbsent;
}

Recording recording_in(const std::string& source, const json& capture, const ReadOptions& options) {
  const json& header = capture.at("Header");
  const double cycle_s = 1e-3 * header.at("CycleTimeMs").get<double>();
  if (!(cycle_s > 0.0 && std::isfinite(cycle_s)))
    throw std::runtime_error(source + ": CycleTimeMs = " + number(1e3 * cycle_s) +
                             " must be positive");
  std::vector<std::string> names;
  for (const json& signal : header.at("SignalListHFData")) names.push_back(column_of(signal));
  if (names.empty() || names.front() != "CYCLE")
    throw std::runtime_error(source + ": the first signal of SignalListHFData is not CYCLE");
  names.front() = "time[s]";

  Layout layout = lay_out(source, names, options);
  Recording recording;
  recording.source = source;
  recording.axes = std::move(layout.axes);
  recording.notes = {"SINUMERIK capture, a row every " + number(1e3 * cycle_s) + " ms"};
  recording.notes.insert(recording.notes.end(), layout.notes.begin(), layout.notes.end());
  double first = kAbsent, last = kAbsent;
  for (const json& block : capture.at("Payload")) {
    if (!block.contains("HFData")) continue;
    for (const json& row : block.at("HFData")) {
      const double cycle = value_in(row, 0);
      if (std::isnan(first)) first = cycle;
      last = cycle_s * (cycle - first);
      if (!(last >= options.from_s && last <= options.to_s)) continue;
      recording.time.push_back(last);
      for (const Layout::Column& column : layout.columns)
        values_of(recording.axes[column.axis], column.channel)
            .push_back(column.unit.to_si(value_in(row, column.index)));
    }
  }
  if (recording.time.empty()) throw_no_rows(source, last, options);
  fill_absent(recording);
  return recording;
}

}  // namespace

bool is_sinumerik_capture(std::string_view start) noexcept {
  constexpr std::size_t kMostBytesBeforeHeader = 64;  // spaces of the formatter
  const std::size_t first = start.find_first_not_of(" \t\r\n");
  return first != std::string_view::npos && start[first] == '{' &&
         start.find("\"Header\"") < first + kMostBytesBeforeHeader;
}

Recording read_sinumerik_capture(const std::filesystem::path& file, const ReadOptions& options) {
  const std::string source = file.string();
  if (std::filesystem::file_size(file) > kMostBytes)
    throw std::runtime_error(source + ": a capture of more than " +
                             std::to_string(kMostBytes >> 20) +
                             " MB does not fit into memory as JSON; capture shorter files");
  try {
    return recording_in(source, json::parse(read_text(file, kMostBytes)), options);
  } catch (const json::exception& error) {
    throw std::runtime_error(source + ": this SINUMERIK capture cannot be read: " + error.what());
  }
}

}  // namespace servotwin
