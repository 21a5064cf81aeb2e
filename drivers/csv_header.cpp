#include "drivers/csv_header.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <stdexcept>
#include <utility>

#include "drivers/text.h"
#include "drivers/time_stamp.h"
#include "drivers/traces/formats.h"
#include "drivers/units.h"

namespace servotwin {
namespace {

bool is_row(const std::vector<std::string>& fields);

/// The separator that occurs most often in this line; blanks if there is none. In a row of numbers
/// commas may be decimal marks.
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

/// A line as G-code programs begin: %, O1234, N10 .., G90 ..
bool is_gcode(std::string_view line) {
  const auto digit = [&](std::size_t at) {
    return at < line.size() && '0' <= line[at] && line[at] <= '9';
  };
  return line.starts_with('%') || (line.find_first_of("GNOgno") == 0 && digit(1));
}

bool is_number(std::string_view field) {
  std::string text(field);
  std::replace(text.begin(), text.end(), ',', '.');
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size();
}

/// Whether these are values and not names.
bool is_row(const std::vector<std::string>& fields) {
  bool any = false;
  for (const std::string& field : fields) {
    const bool value = is_number(field) || parse_time_stamp(field);
    if (!value && !field.empty() && !is_missing_word(field)) return false;
    any = any || value;
  }
  return any;
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

/// A name as UTF-8; other bytes are taken for Latin-1.
std::string utf8_of(const std::string& name) {
  std::size_t at = 0;
  const auto byte = [&](std::size_t i) { return static_cast<unsigned char>(name[i]); };
  while (at < name.size()) {
    const std::size_t more = byte(at) < 0x80             ? 0
                             : (byte(at) & 0xe0) == 0xc0 ? 1
                             : (byte(at) & 0xf0) == 0xe0 ? 2
                             : (byte(at) & 0xf8) == 0xf0 ? 3
                                                         : 4;
    std::size_t continued = 0;
    while (continued < more && at + continued + 1 < name.size() &&
           (byte(at + continued + 1) & 0xc0) == 0x80)
      ++continued;
    if (more == 4 || continued < more) break;
    at += 1 + more;
  }
  if (at == name.size()) return name;
  std::string out;
  for (std::size_t i = 0; i < name.size(); ++i) {
    if (byte(i) < 0x80) {
      out += name[i];
    } else {
      out += static_cast<char>(0xc0 | byte(i) >> 6);
      out += static_cast<char>(0x80 | (byte(i) & 0x3f));
    }
  }
  return out;
}

/// The unit in a cell of a row of units: mm, [mm] or (mm); empty if it is none.
std::string unit_in(std::string_view cell) {
  cell = trimmed(cell);
  if (cell.size() > 2 &&
      ((cell.front() == '[' && cell.back() == ']') || (cell.front() == '(' && cell.back() == ')')))
    cell = cell.substr(1, cell.size() - 2);
  return parse_unit(cell) ? std::string(cell) : std::string();
}

/// Whether these cells are the units of the columns above them: at least one is, and none is a
/// value.
bool is_row_of_units(const std::vector<std::string>& cells) {
  const auto units = std::count_if(cells.begin(), cells.end(),
                                   [](const std::string& cell) { return !unit_in(cell).empty(); });
  return units >= 1 && std::none_of(cells.begin(), cells.end(), [](const std::string& cell) {
           return !cell.empty() && (is_number(cell) || parse_time_stamp(cell));
         });
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

}  // namespace

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

CsvHeader read_csv_header(TextLines& lines, const std::string& source) {
  std::string_view line;
  std::string comment;
  while (true) {
    if (!lines.next(line)) throw std::runtime_error(source + ": has no header line and no rows");
    if (!is_csv_comment(line)) break;
    if (!trimmed(line).empty()) comment = line;
  }
  const std::string first(line);
  if (auto trace = read_trace_header(lines, first)) return *std::move(trace);

  CsvHeader header;
  header.separator = separator_of(first);
  header.names = fields_of(first, header.separator);
  if (header.names.size() > 1 && header.names.back().empty()) header.names.pop_back();
  const bool values =
      is_row(header.names) && (header.separator == ' ' || !are_counted(header.names));
  if (header.names.size() < 2 ||
      (header.separator == ' ' && !values && !is_row_next(lines, header.names.size()))) {
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
  for (std::string& name : header.names) name = utf8_of(name);

  const bool tagged = std::any_of(header.names.begin(), header.names.end(), [](const auto& name) {
    const std::size_t open = name.rfind('[');
    return open != std::string::npos && name.back() == ']' && !unit_in(name.substr(open)).empty();
  });
  if (tagged || !lines.next(line)) return header;
  std::vector<std::string> units = fields_of(line, header.separator);
  for (std::string& unit : units) unit = utf8_of(unit);
  if (units.size() == header.names.size() + 1 && units.back().empty()) units.pop_back();
  if (units.size() > header.names.size() || !is_row_of_units(units)) {
    lines.put_back();
    return header;
  }
  for (std::size_t i = 0; i < units.size(); ++i) {
    if (const std::string unit = unit_in(units[i]); !unit.empty())
      header.names[i] += "[" + unit + "]";
  }
  header.notes.push_back("line " + std::to_string(lines.number()) +
                         " is read as the units of the columns");
  return header;
}

}  // namespace servotwin
