#include "drivers/recordings/table/csv_header.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <stdexcept>
#include <utility>

#include "drivers/common/text.h"
#include "drivers/common/time_stamp.h"
#include "drivers/common/units.h"
#include "drivers/recordings/halscope/halscope.h"
#include "drivers/recordings/table/preamble.h"
#include "drivers/recordings/trace_header.h"

namespace servotwin {
namespace {

/// A line as G-code programs begin: %, O1234, N10 .., G90 ..
bool is_gcode(std::string_view line) {
  const auto digit = [&](std::size_t at) {
    return at < line.size() && '0' <= line[at] && line[at] <= '9';
  };
  return line.starts_with('%') || (line.find_first_of("GNOgno") == 0 && digit(1));
}

/// Whether these are the numbers of columns, 0, 1, 2, .., that some programs write as names, with
/// an empty one before them or not.
bool are_counted(const std::vector<std::string>& fields) {
  const std::size_t first = fields.front().empty() ? 1 : 0;
  if (fields.size() < first + 3) return false;
  for (std::size_t i = first; i < fields.size(); ++i) {
    if (fields[i] != std::to_string(i - first)) return false;
  }
  return true;
}

/// The unit in a cell of a row of units: mm, [mm] or (mm); empty if it is none.
std::string unit_in(std::string_view cell) {
  cell = trimmed(cell);
  if (cell.size() > 2 &&
      ((cell.front() == '[' && cell.back() == ']') || (cell.front() == '(' && cell.back() == ')')))
    cell = cell.substr(1, cell.size() - 2);
  return parse_unit(cell) ? std::string(cell) : std::string();
}

/// Whether the next line has so many values, divided by blanks: words above them are names.
bool is_row_next(TextLines& lines, std::size_t count) {
  std::string_view line;
  if (!lines.next(line)) return false;
  const std::vector<std::string> fields = fields_of(line, ' ');
  lines.put_back();
  return fields.size() == count && is_row(fields);
}

/// The names of columns without a header: those of the comment above, if it has one for each.
std::vector<std::string> names_from(std::string_view comment, std::size_t count,
                                    std::vector<std::string>& notes) {
  const std::size_t first = comment.find_first_not_of("# \t");
  if (first != std::string_view::npos) {
    comment.remove_prefix(first);
    std::vector<std::string> names = fields_of(comment, separator_of(comment));
    if (names.size() == count && !is_row(names)) {
      notes.emplace_back("the names of the columns are those of the comment above them");
      return names;
    }
  }
  std::vector<std::string> names;
  for (std::size_t i = 1; i <= count; ++i) names.push_back(std::to_string(i));
  notes.push_back("there is no header: the columns are called 1 to " + std::to_string(count));
  return names;
}

/// Whether a name has a unit, as in X.command[mm].
bool have_units(const std::vector<std::string>& names) {
  return std::any_of(names.begin(), names.end(), [](const std::string& name) {
    const std::size_t open = name.rfind('[');
    return open != std::string::npos && name.back() == ']' && !unit_in(name.substr(open)).empty();
  });
}

/// The units in this line become a part of the names.
void add_units(CsvHeader& header, const std::vector<std::string>& units, std::size_t line) {
  for (std::size_t i = 0; i < units.size(); ++i) {
    if (const std::string unit = unit_in(units[i]); !unit.empty())
      header.names[i] += "[" + unit + "]";
  }
  header.notes.push_back("line " + std::to_string(line) + " is read as the units of the columns");
}

/// Goes on to the first row below a preamble.
CsvHeader header_below(TextLines& lines, Preamble preamble) {
  CsvHeader header;
  header.separator = preamble.separator;
  header.names = std::move(preamble.names);
  const std::vector<std::string>& units = preamble.units;
  const std::size_t skipped = preamble.rows_line - (units.empty() ? 2 : 3);
  header.notes.push_back("the names of the columns are in line " +
                         std::to_string(preamble.names_line) + "; " +
                         counted(skipped, "other line") + " above the rows skipped");
  if (!units.empty() && !have_units(header.names)) {
    header.remarks.resize(header.names.size());
    for (std::size_t i = 0; i < units.size(); ++i) {
      if (!units[i].empty() && unit_in(units[i]).empty())
        header.remarks[i] = "the row of units says " + in_quotes(units[i]);
    }
    add_units(header, units, preamble.units_line);
  }
  header.rate_hz = preamble.rate_hz;
  if (header.rate_hz)
    header.rate_note =
        number(*header.rate_hz) + " Hz, the sampling rate, is taken from " + preamble.rate_lines[0];
  else
    header.unclear_rates = std::move(preamble.rate_lines);
  std::string_view line;
  while (lines.number() + 1 < preamble.rows_line && lines.next(line)) {
  }
  return header;
}

}  // namespace

std::string utf8_of(const std::string& text) {
  std::size_t at = 0;
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(text[i]); };
  while (at < text.size()) {
    const std::size_t more = byte(at) < 0x80             ? 0
                             : (byte(at) & 0xe0) == 0xc0 ? 1
                             : (byte(at) & 0xf0) == 0xe0 ? 2
                             : (byte(at) & 0xf8) == 0xf0 ? 3
                                                         : 4;
    std::size_t continued = 0;
    while (continued < more && at + continued + 1 < text.size() &&
           (byte(at + continued + 1) & 0xc0) == 0x80)
      ++continued;
    if (more == 4 || continued < more) break;
    at += 1 + more;
  }
  if (at == text.size()) return text;
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (byte(i) < 0x80) {
      out += text[i];
    } else {
      out += static_cast<char>(0xc0 | byte(i) >> 6);
      out += static_cast<char>(0x80 | (byte(i) & 0x3f));
    }
  }
  return out;
}

// The one that occurs most often; but in a row of numbers commas may be decimal marks.
char separator_of(std::string_view line) {
  for (const char candidate : {';', '\t', ' '}) {
    const std::vector<std::string> fields = fields_of(line, candidate);
    const bool divided = std::none_of(fields.begin(), fields.end(), [](const std::string& field) {
      return !field.empty() && field.back() == ',';
    });
    if (fields.size() > 1 && divided && is_row(fields)) return candidate;
  }
  char best = ',';
  for (const char candidate : {';', '\t'}) {
    if (std::count(line.begin(), line.end(), candidate) >
        std::count(line.begin(), line.end(), best)) {
      best = candidate;
    }
  }
  return line.find(best) == std::string_view::npos ? ' ' : best;
}

bool is_number(std::string_view cell) {
  std::string text(cell);
  std::replace(text.begin(), text.end(), ',', '.');
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size();
}

bool is_row(const std::vector<std::string>& fields) {
  bool any = false;
  for (const std::string& field : fields) {
    const bool value = is_number(field) || parse_time_stamp(field);
    if (!value && !field.empty() && !is_missing_word(field)) return false;
    any = any || value;
  }
  return any;
}

bool is_row_of_units(const std::vector<std::string>& cells) {
  const auto units = std::count_if(cells.begin(), cells.end(),
                                   [](const std::string& cell) { return !unit_in(cell).empty(); });
  return units >= 1 && std::none_of(cells.begin(), cells.end(), [](const std::string& cell) {
           return !cell.empty() && (is_number(cell) || parse_time_stamp(cell));
         });
}

std::vector<std::string> fields_of(std::string_view line, char separator) {
  if (separator != ' ') return split_fields(line, separator);
  std::vector<std::string> fields;
  for (std::size_t at = line.find_first_not_of(kBlanks); at != std::string_view::npos;) {
    const std::size_t end = std::min(line.find_first_of(kBlanks, at), line.size());
    fields.emplace_back(line.substr(at, end - at));
    at = line.find_first_not_of(kBlanks, end);
  }
  return fields;
}

bool is_missing_word(std::string_view cell) {
  constexpr std::array kWords{"N/A", "n/a", "#N/A", "NA", "null", "NULL", "None", "-", "--", "#NV"};
  return std::find(kWords.begin(), kWords.end(), cell) != kWords.end();
}

bool is_csv_comment(std::string_view line) {
  line = trimmed(line);
  // Spreadsheets write #N/A where there is no value.
  return line.empty() || (line.front() == '#' && !line.starts_with("#N"));
}

bool is_table(std::string_view start) {
  const std::string_view line = start.substr(0, start.find('\n'));
  return line.find_first_of(",;\t") != std::string_view::npos || is_trace(line);
}

CsvHeader read_csv_header(TextLines& lines, const std::string& source,
                          std::optional<RecordingFormat> named) {
  std::string_view line;
  std::string comment;
  while (true) {
    if (!lines.next(line)) throw std::runtime_error(source + ": has no header line and no rows");
    if (!is_csv_comment(line)) break;
    if (!trimmed(line).empty()) comment = line;
  }
  const std::string first(line);
  const std::optional<double> halscope_hz = halscope_table_rate_hz(comment);
  const bool table_named =
      named == RecordingFormat::kTable || (named == RecordingFormat::kHalscope && halscope_hz);
  if (!table_named) {
    if (auto trace = read_trace_header(lines, first, named)) return *std::move(trace);
  }

  CsvHeader header;
  header.separator = separator_of(first);
  header.names = fields_of(first, header.separator);
  if (header.names.size() > 1 && header.names.back().empty()) header.names.pop_back();
  const bool values =
      is_row(header.names) && (header.separator == ' ' || !are_counted(header.names));
  // One name is enough if it is sure to be one.
  const bool sure = halscope_hz || have_units(header.names);
  if (header.names.size() == 1 && sure) header.separator = ';';
  const bool none =
      (header.names.size() < 2 && !sure) ||
      (header.separator == ' ' && !values && !is_row_next(lines, header.names.size()));
  if (auto preamble =
          find_preamble(source, lines.number(), none ? 0 : header.names.size(), header.separator))
    return header_below(lines, *std::move(preamble));
  if (none) {
    lines.fail("this is text, but not CSV: " + in_quotes(first) +
               " is not a header such as time[s],X.command[mm],X.actual[mm]" +
               (is_gcode(first)
                    ? "; G-code has no times: let the control run it, dry or simulated, and "
                      "record what it commands"
                    : ""));
  }
  if (values) {
    header.names = names_from(comment, header.names.size(), header.notes);
    lines.put_back();
    return header;
  }
  header.rate_hz = halscope_hz;
  if (header.rate_hz)
    header.notes.push_back("halscope recording at " + number(*header.rate_hz) + " Hz");
  for (std::string& name : header.names) name = utf8_of(name);
  if (have_units(header.names) || !lines.next(line)) return header;
  std::vector<std::string> units = fields_of(line, header.separator);
  for (std::string& unit : units) unit = utf8_of(unit);
  if (units.size() == header.names.size() + 1 && units.back().empty()) units.pop_back();
  if (units.size() > header.names.size() || !is_row_of_units(units)) {
    lines.put_back();
    return header;
  }
  add_units(header, units, lines.number());
  return header;
}

}  // namespace servotwin
