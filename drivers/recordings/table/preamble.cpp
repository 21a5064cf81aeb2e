#include "drivers/recordings/table/preamble.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>

#include "drivers/common/text.h"
#include "drivers/common/text_lines.h"
#include "drivers/common/time_stamp.h"
#include "drivers/common/units.h"
#include "drivers/recordings/table/csv_header.h"

namespace servotwin {
namespace {

using namespace std::string_view_literals;

constexpr std::size_t kMostPreambleLines = 200;  // some recorders write a line for each channel
constexpr std::size_t kFewestRows = 3;  // a row of numbers may be a setting; unless the file ends

struct PreambleLine {
  std::size_t number = 0;
  bool complete = true;
  std::string text;
  char separator = ',';
  std::size_t fields = 0;
  bool is_row = false;
};

/// As is_row(), also with plus signs.
bool is_signed_row(std::vector<std::string> fields) {
  for (std::string& field : fields) {
    if (field.size() > 1 && field.front() == '+') field.erase(0, 1);
  }
  return is_row(fields);
}

/// Whether this cell cannot be a value.
bool is_word(const std::string& cell) {
  const bool letters = std::any_of(cell.begin(), cell.end(), [](char c) {
    const bool latin = ('a' <= c && c <= 'z') || ('A' <= c && c <= 'Z');
    return (latin && c != 'e' && c != 'E') || static_cast<unsigned char>(c) >= 0x80;
  });
  return letters && !is_number(cell.front() == '+' ? cell.substr(1) : cell) &&
         !parse_time_stamp(cell) && !is_missing_word(cell);
}

/// One separator at the end of a line closes the last field.
std::vector<std::string> without_empty_end(std::vector<std::string> fields) {
  if (fields.size() > 1 && fields.back().empty()) fields.pop_back();
  return fields;
}

std::vector<PreambleLine> beginning_of(const std::string& file, std::size_t first_line,
                                       bool& ends) {
  std::vector<PreambleLine> out;
  TextLines lines(file);
  std::string_view line;
  while (out.size() < kMostPreambleLines) {
    ends = !lines.next(line);
    if (ends) break;
    if (lines.number() < first_line || is_csv_comment(line)) continue;
    const std::string text = utf8_of(std::string(line));
    const char separator = separator_of(text);
    const std::vector<std::string> fields = fields_of(text, separator);
    out.push_back({lines.number(), lines.complete(), text, separator, fields.size(),
                   fields.size() > 1 && is_signed_row(fields)});
  }
  return out;
}

/// The place of the first of several rows; the number of lines if there is none.
std::size_t first_row(const std::vector<PreambleLine>& lines, bool ends) {
  for (std::size_t i = 0; i < lines.size(); ++i) {
    std::size_t next = i;
    while (next < lines.size() && lines[next].is_row &&
           lines[next].separator == lines[i].separator && lines[next].fields == lines[i].fields)
      ++next;
    if (next - i >= kFewestRows || (next > i && ends && next == lines.size())) return i;
  }
  return lines.size();
}

struct FoundRows {
  std::size_t row = 0;  ///< the place of the first
  char separator = ',';
};

/// Whether this cell can be in a column of numbers.
bool is_value(const std::string& cell) {
  return cell.empty() || is_signed_row({cell}) || is_missing_word(cell);
}

/// The first row where each row has a word, such as a mode. Settings look the same, so these rows
/// have to go on to the end of what was read. In a column of numbers each of them has one.
std::optional<FoundRows> first_row_with_words(std::vector<PreambleLine> lines, bool ends) {
  if (!lines.empty() && !lines.back().complete) lines.pop_back();
  for (const char separator : {';', '\t', ','}) {
    std::vector<std::size_t> numbers;  // the columns
    std::size_t fields = 0, row = lines.size();
    while (row > 0) {
      const std::vector<std::string> cells = fields_of(lines[row - 1].text, separator);
      if (row == lines.size()) {
        fields = cells.size();
        for (std::size_t i = 0; i < fields; ++i) {
          if (is_signed_row({cells[i]})) numbers.push_back(i);
        }
      }
      const auto has_value = [&](std::size_t i) { return is_value(cells[i]); };
      if (cells.size() != fields || !std::all_of(numbers.begin(), numbers.end(), has_value)) break;
      --row;
    }
    const std::size_t rows = lines.size() - row;
    if (fields > 1 && !numbers.empty() && (rows >= kFewestRows || (rows > 0 && ends)))
      return FoundRows{row, separator};
  }
  return std::nullopt;
}

/// Whether the lines below a first line of so many names could be its rows.
bool could_be_rows(const std::vector<PreambleLine>& lines, std::size_t end, std::size_t columns,
                   char separator) {
  for (std::size_t i = 1; i < end; ++i) {
    if (!lines[i].complete) continue;
    std::vector<std::string> fields = fields_of(trimmed(lines[i].text), separator);
    if (fields.size() == columns + 1) fields = without_empty_end(std::move(fields));
    if (i == 1 && fields.size() <= columns && is_row_of_units(fields)) continue;
    if (fields.size() != columns || std::all_of(fields.begin(), fields.end(), is_word))
      return false;
  }
  return true;
}

/// Whether a line has a field for each column of such a row.
bool has_field_each(std::vector<std::string>& fields, const std::vector<std::string>& row) {
  if (fields.size() == row.size() + 1) fields = without_empty_end(std::move(fields));
  return fields.size() == row.size() || (fields.size() + 1 == row.size() && row.back().empty());
}

/// Whether these are the names of most columns, and nothing else.
bool are_names(const std::vector<std::string>& fields) {
  const auto words = std::count_if(fields.begin(), fields.end(), is_word),
             empty = std::count(fields.begin(), fields.end(), std::string());
  const auto count = static_cast<std::ptrdiff_t>(fields.size());
  return words + empty == count && 2 * words > count;
}

// Sampling ------------------------------------------------------------------

/// Letters of what settings are called, small and without anything between them.
constexpr std::array kIntervals{
    "samplinginterval"sv,  "sampleinterval"sv,       "samplingperiod"sv,     "sampleperiod"sv,
    "samplingtime"sv,      "sampletime"sv,           "samplingcycle"sv,      "samplecycle"sv,
    "samplingcycletime"sv, "samplingtimeinterval"sv, "sampletimeinterval"sv, "samplingstep"sv,
    "interval"sv,          "timeinterval"sv,         "timestep"sv,           "cycletime"sv,
    "abtastzeit"sv,        "abtastintervall"sv,      "abtastperiode"sv,      "abtastzyklus"sv,
    "abtastschritt"sv,     "zykluszeit"sv,           "taktzeit"sv,           "messintervall"sv,
    "zeitintervall"sv,     "zeitschritt"sv};
constexpr std::array kRates{"samplingrate"sv,    "samplerate"sv,       "samplingfrequency"sv,
                            "samplefrequency"sv, "samplespersecond"sv, "abtastrate"sv,
                            "abtastfrequenz"sv,  "messrate"sv,         "messfrequenz"sv};

std::string small_letters(std::string_view text) {
  std::string out;
  for (const char c : text) {
    if ('a' <= c && c <= 'z') out += c;
    if ('A' <= c && c <= 'Z') out += static_cast<char>(c - 'A' + 'a');
  }
  return out;
}

/// A unit of time or of frequency.
struct SamplingUnit {
  double si = 1.0;
  bool is_rate = false;
};

std::optional<SamplingUnit> sampling_unit(std::string_view text) {
  if (const auto unit = parse_unit(text); unit && unit->quantity == Quantity::kTime)
    return SamplingUnit{unit->to_si(1.0), false};
  struct Known {
    std::string_view name;
    double si;
    bool is_rate;
  };
  constexpr std::array kKnown{
      Known{"sec", 1.0, false}, Known{"msec", 1e-3, false}, Known{"usec", 1e-6, false},
      Known{"hz", 1.0, true},   Known{"khz", 1e3, true},    Known{"mhz", 1e6, true},
      Known{"s/s", 1.0, true},  Known{"ks/s", 1e3, true},   Known{"ms/s", 1e6, true},
      Known{"sa/s", 1.0, true}, Known{"1/s", 1.0, true}};
  std::string small(text);
  std::transform(small.begin(), small.end(), small.begin(), [](char c) {
    return 'A' <= c && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  });
  for (const Known& known : kKnown) {
    if (known.name == small) return SamplingUnit{known.si, known.is_rate};
  }
  return std::nullopt;
}

/// Takes a number from the beginning of a text. 1,250 is none: it may be a number of thousands; nor
/// is 1.000 between semicolons, where commas are decimal marks.
std::optional<double> take_number(std::string_view& text, char separator) {
  const std::size_t end = std::min(text.find_first_not_of("0123456789.,eE+-"), text.size());
  std::string digits(text.substr(0, end));
  const std::size_t comma = digits.find(',');
  if (comma <= 3 && digits.front() != '0' && digits.size() == comma + 4) return std::nullopt;
  const std::size_t point = digits.find('.');
  if (separator == ';' && point <= 3 && digits.front() != '0' && digits.size() == point + 4)
    return std::nullopt;
  std::replace(digits.begin(), digits.end(), ',', '.');
  double value = 0.0;
  const auto [read, error] = std::from_chars(digits.data(), digits.data() + digits.size(), value);
  if (error != std::errc() || read != digits.data() + digits.size()) return std::nullopt;
  text.remove_prefix(end);
  return value;
}

/// A line that names the interval or the rate of sampling.
struct SamplingCells {
  bool is_rate = false;
  std::string value, unit;  ///< the unit of the name or of the third cell, or none
};

std::optional<SamplingCells> sampling_cells(std::string_view line, char separator) {
  std::vector<std::string> cells{std::string(trimmed(line))};
  if (separator != ' ' && line.find(separator) != std::string_view::npos)
    cells = split_fields(line, separator);
  // "Sample rate: 1 kHz" is name and value in one cell.
  if (const std::size_t digit = cells.front().find_first_of("0123456789");
      digit != std::string::npos) {
    cells.insert(cells.begin() + 1, cells.front().substr(digit));
    cells.front().resize(digit);
  }
  if (cells.size() < 2) return std::nullopt;

  SamplingCells out{false, cells[1], {}};
  std::string_view name = trimmed(cells[0]);
  name = trimmed(name.substr(0, name.find_last_not_of(" :=") + 1));
  if (const std::size_t open = name.find_last_of("[(");
      open != std::string_view::npos && (name.back() == ']' || name.back() == ')')) {
    out.unit = trimmed(name.substr(open + 1, name.size() - open - 2));
    name = name.substr(0, open);
  }
  const auto is_name = [letters = small_letters(name)](std::string_view known) {
    return known == letters;
  };
  out.is_rate = std::any_of(kRates.begin(), kRates.end(), is_name);
  if (!out.is_rate && std::none_of(kIntervals.begin(), kIntervals.end(), is_name))
    return std::nullopt;
  // Some recorders write name and value for each channel.
  if (out.unit.empty() && cells.size() > 2 && !is_value(cells[2]) && cells[2] != cells[0])
    out.unit = cells[2];
  return out;
}

/// What the settings above the rows say about the sampling.
void find_rate(const std::vector<PreambleLine>& lines, std::size_t row, Preamble& preamble) {
  std::vector<double> rates_hz;
  std::vector<std::string> clear, unclear;
  for (std::size_t i = 0; i < row; ++i) {
    if (lines[i].number == preamble.names_line || lines[i].number == preamble.units_line) continue;
    const bool divided = lines[i].text.find(preamble.separator) != std::string::npos;
    const char separator = divided ? preamble.separator : lines[i].separator;
    if (!sampling_cells(lines[i].text, separator)) continue;
    const auto rate_hz = sampling_rate_in(lines[i].text, separator);
    (rate_hz ? clear : unclear)
        .push_back("line " + std::to_string(lines[i].number) + ", " + in_quotes(lines[i].text));
    if (rate_hz) rates_hz.push_back(*rate_hz);
  }
  if (rates_hz.empty()) {
    preamble.rate_lines = std::move(unclear);
    return;
  }
  constexpr double kRounded = 1e-3;  // 0.333 ms and 3 kHz are the same
  const auto [least, most] = std::minmax_element(rates_hz.begin(), rates_hz.end());
  if (*most - *least <= kRounded * *most) preamble.rate_hz = rates_hz.front();
  if (preamble.rate_hz) clear.resize(1);
  preamble.rate_lines = std::move(clear);
}

}  // namespace

std::optional<double> sampling_rate_in(std::string_view line, char separator) {
  const std::optional<SamplingCells> found = sampling_cells(line, separator);
  if (!found) return std::nullopt;
  std::string_view rest = found->value, unit = found->unit;
  const std::optional<double> value = take_number(rest, separator);
  if (!value) return std::nullopt;
  if (!trimmed(rest).empty()) unit = trimmed(rest);
  const auto known = unit.empty() ? SamplingUnit{1.0, found->is_rate} : sampling_unit(unit);
  if (!known) return std::nullopt;
  const double si = *value * known->si, rate_hz = known->is_rate ? si : 1.0 / si;
  constexpr double kMost_hz = 1e9;
  return si > 0.0 && std::isfinite(rate_hz) && rate_hz <= kMost_hz ? std::optional(rate_hz)
                                                                   : std::nullopt;
}

std::optional<Preamble> find_preamble(const std::string& file, std::size_t first_line,
                                      std::size_t columns, char separator) {
  bool ends = false;
  const std::vector<PreambleLine> lines = beginning_of(file, first_line, ends);
  FoundRows rows{first_row(lines, ends)};
  if (rows.row < lines.size()) {
    rows.separator = lines[rows.row].separator;
  } else if (const auto with_words = first_row_with_words(lines, ends)) {
    rows = *with_words;
  }
  const std::size_t row = rows.row;
  if (row == lines.size() || row < 2) return std::nullopt;
  if (columns > 0 && could_be_rows(lines, row, columns, separator)) return std::nullopt;

  Preamble out;
  out.separator = rows.separator;
  out.rows_line = lines[row].number;
  const std::vector<std::string> cells = fields_of(lines[row].text, out.separator);
  for (std::size_t i = row; i-- > 0 && out.names.empty();) {
    std::vector<std::string> fields = fields_of(lines[i].text, out.separator);
    const bool units = out.units.empty() && is_row_of_units(fields);
    if (!has_field_each(fields, cells) || (!units && !are_names(fields))) continue;
    (units ? out.units_line : out.names_line) = lines[i].number;
    (units ? out.units : out.names) = std::move(fields);
  }
  if (out.names.empty()) {  // columns may be called V and A
    out.names = std::move(out.units);
    out.units.clear();
    out.names_line = out.units_line;
  }
  if (out.names.empty() || out.names_line == first_line) return std::nullopt;
  find_rate(lines, row, out);
  return out;
}

}  // namespace servotwin
