#include "drivers/recordings/table/csv.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <charconv>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "drivers/common/checksum.h"
#include "drivers/common/file_handle.h"
#include "drivers/common/memory.h"
#include "drivers/common/text.h"
#include "drivers/common/text_lines.h"
#include "drivers/common/time_stamp.h"
#include "drivers/common/units.h"
#include "drivers/recordings/column_map.h"
#include "drivers/recordings/table/csv_header.h"

namespace servotwin {
namespace {

constexpr std::size_t kChecksumBlock_bytes = 1 << 20;  // read at a time

/// Cuts rows into the cells that are wanted, without copying, and checks the number of fields.
class RowCutter {
 public:
  // `wanted`: places of the wanted columns in the file, in any order.
  RowCutter(const CsvHeader& header, std::vector<std::size_t> wanted)
      : header_(header), wanted_(std::move(wanted)), order_(wanted_.size()) {
    for (std::size_t i = 0; i < order_.size(); ++i) order_[i] = i;
    std::sort(order_.begin(), order_.end(),
              [&](std::size_t a, std::size_t b) { return wanted_[a] < wanted_[b]; });
  }

  /// Whether a row of so many fields has all wanted ones.
  [[nodiscard]] bool reached(std::size_t fields) const {
    return order_.empty() || wanted_[order_.back()] < fields;
  }
  /// Fills `cells` in the order of `wanted`; returns the number of fields of the row.
  std::size_t cut(std::string_view line, std::vector<std::string_view>& cells) {
    if (header_.separator == ' ' || line.find('"') != std::string_view::npos)
      return cut_copied(line, cells);
    const char* at = line.data();
    const char* const end = at + line.size();
    const auto field_end = [&] {
      const auto* found = static_cast<const char*>(
          std::memchr(at, header_.separator, static_cast<std::size_t>(end - at)));
      return found == nullptr ? end : found;
    };
    std::size_t field = 0;
    for (const std::size_t next : order_) {
      for (; field < wanted_[next]; ++field) {
        at = field_end();
        if (at == end) return field + 1;
        ++at;
      }
      cells[next] = std::string_view(at, static_cast<std::size_t>(field_end() - at));
    }
    const auto more = static_cast<std::size_t>(std::count(at, end, header_.separator));
    // One separator at the very end closes the last field, it opens no further one.
    const bool trailing = field + more == header_.names.size() && line.back() == header_.separator;
    return field + more + (trailing ? 0 : 1);
  }

 private:
  std::size_t cut_copied(std::string_view line, std::vector<std::string_view>& cells) {
    fields_ = fields_of(line, header_.separator);
    if (fields_.size() == header_.names.size() + 1 && fields_.back().empty()) fields_.pop_back();
    for (std::size_t i = 0; i < wanted_.size() && fields_.size() == header_.names.size(); ++i) {
      cells[i] = fields_[wanted_[i]];
    }
    return fields_.size();
  }

  const CsvHeader& header_;
  std::vector<std::size_t> wanted_;
  std::vector<std::size_t> order_;   // of wanted_, from left to right in the file
  std::vector<std::string> fields_;  // of a row with quotes or blanks, which the cells point into
};

enum class Cell { kNumber, kMissing, kNoNumber };

Cell parse_number(std::string_view cell, double& value) {
  const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
  if (end != cell.data() + cell.size() || error == std::errc::invalid_argument) {
    return Cell::kNoNumber;
  }
  // A number out of range is too large or too small for a double; only the C function distinguishes
  // them.
  if (error == std::errc::result_out_of_range)
    value = std::strtod(std::string(cell).c_str(), nullptr);
  if (std::isfinite(value)) return Cell::kNumber;
  value = kAbsent;
  return Cell::kMissing;
}

/// The numbers of one column. A column has one decimal mark: the first cell that shows it decides.
/// The other mark may then divide thousands.
class CellReader {
 public:
  /// `separator` of the columns: numbers cannot have it.
  CellReader(char separator, bool is_time) : comma_(separator != ','), is_time_(is_time) {}

  /// SI is not known here: `value` is in the unit of the column, `stamped` whether it is in seconds
  /// because the cell was a date or a time of day.
  Cell read(std::string_view cell, double& value, bool& stamped) {
    stamped = false;
    cell = trimmed(cell);
    if (!cell.empty() && cell.front() == '+') cell.remove_prefix(1);
    value = kAbsent;
    if (cell.empty() || is_missing_word(cell)) return Cell::kMissing;
    const bool has_comma = comma_ && cell.find(',') != std::string_view::npos;
    if (!has_comma) {
      if (mark_ == ',' && cell.find('.') != std::string_view::npos) {
        if (!with_point(cell)) return stamp(cell, value, stamped);
        return parse_number(copy_, value);
      }
      if (mark_ == 0 && cell.find('.') != std::string_view::npos) mark_ = '.';
      const Cell plain = parse_number(cell, value);
      return plain == Cell::kNoNumber ? stamp(cell, value, stamped) : plain;
    }
    if (mark_ == 0)
      mark_ =
          cell.find('.') > cell.rfind(',') && cell.find('.') != std::string_view::npos ? '.' : ',';
    if (mark_ == ',') count_comma(cell);
    const Cell number = with_point(cell) ? parse_number(copy_, value) : Cell::kNoNumber;
    return number == Cell::kNoNumber ? stamp(cell, value, stamped) : number;
  }

  [[nodiscard]] bool has_decimal_comma() const { return mark_ == ','; }
  /// Whether every comma of the column could divide thousands as well: 1,250.
  [[nodiscard]] bool is_ambiguous() const { return thousands_ > 0 && commas_ == thousands_; }

 private:
  /// Copies the cell with a decimal point and without marks of thousands, which divide groups of
  /// three digits; false if it is not written so.
  bool with_point(std::string_view cell) {
    const char thousands = mark_ == ',' ? '.' : ',';
    copy_.clear();
    const std::size_t decimal = std::min(cell.find(mark_), cell.size());
    std::size_t digits = 0;  // since the last mark of thousands
    bool grouped = false, exponent = false;
    for (std::size_t i = 0; i < cell.size(); ++i) {
      const char c = cell[i];
      if (c == thousands) {
        if (i > decimal || digits == 0 || digits > 3 || (grouped && digits != 3)) return false;
        grouped = true;
        digits = 0;
        continue;
      }
      if (i == decimal && grouped && digits != 3) return false;
      if (c == 'e' || c == 'E') exponent = true;
      digits += !exponent && '0' <= c && c <= '9' ? 1 : 0;
      copy_ += i == decimal ? '.' : c;
    }
    return !(grouped && decimal == cell.size() && digits != 3);
  }

  /// Counts the cells with a decimal comma, and those of them that could be thousands.
  void count_comma(std::string_view cell) {
    ++commas_;
    if (!cell.empty() && cell.front() == '-') cell.remove_prefix(1);
    const std::size_t comma = cell.find(',');
    const auto is_digit = [](char c) { return '0' <= c && c <= '9'; };
    const bool groups = 1 <= comma && comma <= 3 && cell.size() == comma + 4 &&
                        cell.front() != '0' &&
                        std::all_of(cell.begin(), cell.begin() + comma, is_digit) &&
                        std::all_of(cell.begin() + comma + 1, cell.end(), is_digit);
    thousands_ += groups ? 1 : 0;
  }

  Cell stamp(std::string_view cell, double& value, bool& stamped) {
    value = kAbsent;
    const auto read = is_time_ ? parse_time_stamp(cell) : std::nullopt;
    if (!read) return Cell::kNoNumber;
    stamped = true;
    value = clock_.seconds(*read);
    return Cell::kNumber;
  }

  bool comma_, is_time_;
  char mark_ = 0;  // 0: not known yet
  std::size_t commas_ = 0, thousands_ = 0;
  std::string copy_;
  StampClock clock_;
};

// The characters after the point, an exponent included: a number that was cut off has fewer of
// them.
std::size_t decimals(std::string_view cell) {
  cell = trimmed(cell);
  const std::size_t point = cell.find_last_of(".,");
  return point == std::string_view::npos ? 0 : cell.size() - point - 1;
}

// Estimates the number of rows from line ends in blocks spread over the file, to reserve memory or
// to refuse the file.
std::uint64_t estimate_rows(const std::filesystem::path& file) {
  constexpr std::uint64_t kSamples = 16, kSample = 1 << 16;
  const FileHandle handle = FileHandle::open(file, O_RDONLY);
  const std::uint64_t size = std::filesystem::file_size(file);
  std::string block(kSample, '\0');
  std::uint64_t bytes = 0, ends = 0;
  for (std::uint64_t i = 0; i < kSamples && bytes < size; ++i) {
    const std::size_t count = handle.read_at(block.data(), block.size(), size / kSamples * i);
    bytes += count;
    ends += static_cast<std::uint64_t>(
        std::count(block.begin(), block.begin() + static_cast<std::ptrdiff_t>(count), '\n'));
  }
  const double per_byte =
      static_cast<double>(ends) / static_cast<double>(std::max<std::uint64_t>(bytes, 1));
  return static_cast<std::uint64_t>(1.02 * per_byte * static_cast<double>(size)) + 64;
}

/// Throws if the file ends with a checksum that is not that of the bytes before it.
void require_checksum(const std::filesystem::path& file) {
  if (!std::filesystem::is_regular_file(file)) return;        // a pipe cannot be read twice
  constexpr std::size_t kLine = kChecksumComment.size() + 9;  // eight digits and the line end
  const std::uint64_t size = std::filesystem::file_size(file);
  if (size < kLine) return;
  const FileHandle handle = FileHandle::open(file, O_RDONLY);
  std::string last(kLine, '\0');
  last.resize(handle.read_at(last.data(), kLine, size - kLine));
  if (!last.starts_with(kChecksumComment) || !last.ends_with('\n')) return;
  std::string block(kChecksumBlock_bytes, '\0');
  std::uint32_t crc32 = 0;
  for (std::uint64_t left = size - kLine; left > 0;) {
    const std::size_t count =
        handle.read(block.data(), std::min<std::uint64_t>(kChecksumBlock_bytes, left));
    if (count == 0) break;
    crc32 = crc32_of(std::string_view(block.data(), count), crc32);
    left -= count;
  }
  last.pop_back();
  if (last.substr(kChecksumComment.size()) != crc32_text(crc32))
    throw std::runtime_error(file.string() + ": its checksum does not match (" + in_quotes(last) +
                             " in its last line, " + crc32_text(crc32) +
                             " of its content): it was damaged since it was recorded; if it was "
                             "changed on purpose, delete its last line");
}

/// Stores the values of the rows and counts those that are missing.
class Columns {
 public:
  Columns(const std::filesystem::path& file, Layout& layout, Recording& recording)
      : file_(file), recording_(recording) {
    values_.push_back(&recording.time);
    names_.emplace_back("time");
    for (const Layout::Column& column : layout.columns) {
      values_.push_back(&values_of(recording.axes[column.axis], column.channel));
      names_.push_back(column.name);
    }
    missing_.resize(values_.size());
    first_missing_.resize(values_.size());
  }

  void reserve(std::uint64_t rows) {
    require_memory(file_, rows - recording_.time.size(), values_.size());
    for (auto* values : values_) values->reserve(rows);
  }

  void add(const std::vector<double>& row, std::size_t line) {
    const std::size_t rows = recording_.time.size();
    if (rows == recording_.time.capacity()) reserve(std::max<std::uint64_t>(2 * rows, 1024));
    for (std::size_t i = 0; i < row.size(); ++i) {
      values_[i]->push_back(row[i]);
      if (std::isnan(row[i]) && missing_[i]++ == 0) first_missing_[i] = line;
    }
  }

  void note_missing() {
    for (std::size_t i = 0; i < values_.size(); ++i) {
      if (missing_[i] == 0) continue;
      recording_.notes.push_back(names_[i] + ": empty, NaN or infinite in " +
                                 std::to_string(missing_[i]) + " of " +
                                 counted(recording_.time.size(), "row") + ", the first in line " +
                                 std::to_string(first_missing_[i]));
    }
  }

 private:
  const std::filesystem::path& file_;
  Recording& recording_;
  std::vector<std::vector<double>*> values_;
  std::vector<std::string> names_;
  std::vector<std::size_t> missing_, first_missing_;
};

/// The columns to read, with the times that they have in this file.
Layout layout_of(const std::string& source, const CsvHeader& header, const ReadOptions& options) {
  if (header.time_of.empty()) {
    Layout layout = lay_out(source, header.names, options, header.rate_hz, header.unclear_rates);
    if (!layout.time && !options.rate_hz && !header.rate_note.empty())
      layout.notes.push_back(header.rate_note);
    return layout;
  }
  if (options.rate_hz)
    throw std::runtime_error(source + ": --rate is for files without time, and this one has times");
  constexpr double kAny_hz = 1.0;  // the times are found here, by the columns that are read
  Layout layout = lay_out(source, header.names, options, kAny_hz);
  if (layout.time) return layout;
  const std::size_t first = layout.columns.front().index;
  for (const Layout::Column& column : layout.columns) {
    const double step = header.step_ms[column.index], wanted = header.step_ms[first];
    const bool one_group = header.time_of[column.index] == header.time_of[first];
    if (!one_group && std::isnan(step))
      throw std::runtime_error(source + ": " + in_quotes(header.names[first]) + " and " +
                               in_quotes(header.names[column.index]) +
                               " have times of their own, and the file does not say that they were "
                               "sampled together");
    if (!one_group && header.begins_ms[column.index] != header.begins_ms[first])
      throw std::runtime_error(source + ": " + in_quotes(header.names[first]) + " begins at " +
                               number(header.begins_ms[first]) + " ms and " +
                               in_quotes(header.names[column.index]) + " at " +
                               number(header.begins_ms[column.index]) +
                               " ms; export what belongs together from one time on");
    if (!one_group && step != wanted)
      throw std::runtime_error(source + ": " + in_quotes(header.names[first]) +
                               " was sampled every " + number(wanted) + " ms and " +
                               in_quotes(header.names[column.index]) + " every " + number(step) +
                               " ms; record what belongs together at one rate, or name columns of "
                               "one rate with --columns");
  }
  layout.time = header.time_of[first];
  layout.time_unit = *parse_unit("ms");
  return layout;
}

/// What may be wrong with a cell that is no number; continues the message.
std::string why_no_number(const CsvHeader& header, const CellReader& reader,
                          std::string_view cell) {
  const bool comma = cell.find(',') != std::string_view::npos;
  if (header.separator == ',' && comma)
    return "; where , separates the columns, decimals need a point";
  if (reader.has_decimal_comma() && cell.find('.') != std::string_view::npos)
    return "; the rows above have a decimal comma";
  return comma ? "; the rows above have a decimal point" : "";
}

}  // namespace

Recording read_csv(const std::filesystem::path& file, const ReadOptions& options) {
  const std::string source = file.string();
  require_checksum(file);
  TextLines lines(file);
  const CsvHeader header = read_csv_header(lines, source, options.format);
  Layout layout = layout_of(source, header, options);

  Recording recording;
  recording.source = source;
  recording.axes = std::move(layout.axes);
  recording.notes = header.notes;
  recording.notes.insert(recording.notes.end(), layout.notes.begin(), layout.notes.end());
  Columns columns(file, layout, recording);
  if (!selects_part(options)) columns.reserve(estimate_rows(file));

  // Cells of a row: the time, if the file has it, and the channels. Values: always with the time.
  std::vector<std::size_t> wanted;
  if (layout.time) wanted.push_back(*layout.time);
  for (const Layout::Column& column : layout.columns) wanted.push_back(column.index);
  RowCutter cutter(header, wanted);
  std::vector<std::string_view> cells(wanted.size());
  std::vector<CellReader> readers;
  for (std::size_t i = 0; i < wanted.size(); ++i)
    readers.emplace_back(header.separator, layout.time && i == 0);
  std::vector<double> row(layout.columns.size() + 1);

  double first_time = kAbsent, time = kAbsent;
  std::size_t rows = 0, outside = 0;
  // The last cell of a line without a line end may be cut off; its place, if it is read.
  const auto at_the_end = static_cast<std::size_t>(
      std::find(wanted.begin(), wanted.end(), header.names.size() - 1) - wanted.begin());
  std::size_t decimals_before = 0;
  std::string_view line;
  while (lines.next(line)) {
    if (is_csv_comment(line)) continue;
    if (!header.ends_with.empty() && line == header.ends_with) break;
    while (header.separator != ' ' && !line.empty() && line.back() == ' ') line.remove_suffix(1);
    const bool own_times = !header.time_of.empty();
    if (own_times) std::fill(cells.begin(), cells.end(), std::string_view());
    const std::size_t fields = cutter.cut(line, cells);
    if (own_times && fields < header.names.size()) {
      // Channels that were sampled less often have ended.
      if (!lines.complete()) {
        recording.notes.push_back("line " + std::to_string(lines.number()) +
                                  ", the last one, is cut off and was dropped");
        break;
      }
      if (!cutter.reached(fields) || trimmed(cells.front()).empty()) continue;
    } else if (fields != header.names.size()) {
      if (fields < header.names.size() && !lines.complete()) {
        recording.notes.push_back("line " + std::to_string(lines.number()) +
                                  ", the last one, is cut off and was dropped");
        break;
      }
      lines.fail(counted(fields, "field") + " where the header has " +
                 std::to_string(header.names.size()));
    }
    if (at_the_end < cells.size()) {
      const std::string_view cell = cells[at_the_end];
      double value = 0.0;
      bool stamped = false;
      if (!lines.complete() &&
          (decimals(cell) < decimals_before || is_missing_word(trimmed(cell)) ||
           readers[at_the_end].read(cell, value, stamped) == Cell::kNoNumber)) {
        recording.notes.push_back("line " + std::to_string(lines.number()) +
                                  ", the last one, has no line end, and " + in_quotes(cell) +
                                  " is shorter than the number above it: dropped as cut off");
        break;
      }
      decimals_before = decimals(cell);
    }
    if (!lines.complete()) {
      recording.notes.push_back("line " + std::to_string(lines.number()) +
                                ", the last one, has no line end; kept as complete");
    }
    const std::size_t skipped = layout.time ? 0 : 1;  // values without a cell
    for (std::size_t i = 0; i < cells.size(); ++i) {
      double& value = row[i + skipped];
      bool stamped = false;
      if (readers[i].read(cells[i], value, stamped) == Cell::kNoNumber) {
        lines.fail("column " + in_quotes(header.names[wanted[i]]) + ": " + in_quotes(cells[i]) +
                   " is not a number" + why_no_number(header, readers[i], cells[i]));
      }
      if (stamped) continue;  // in seconds already
      const bool is_time = i + skipped == 0;
      value = (is_time ? layout.time_unit : layout.columns[i + skipped - 1].unit).to_si(value);
    }
    if (own_times && std::isnan(row[0])) continue;
    if (!layout.time)
      row[0] = static_cast<double>(rows) / options.rate_hz.value_or(header.rate_hz.value_or(1.0));
    ++rows;

    if (!std::isnan(row[0])) {
      time = row[0];
      if (std::isnan(first_time)) first_time = time;
    }
    // A row without a time is treated as having the time of the row before it.
    const double since_start = time - first_time;
    if (selects_part(options) && !(since_start >= options.from_s && since_start <= options.to_s)) {
      ++outside;
      continue;
    }
    columns.add(row, lines.number());
  }

  if (recording.time.empty()) throw_no_rows(source, time - first_time, options);
  if (outside > 0) {
    recording.notes.push_back("outside --from and --to: " + std::to_string(outside) + " of " +
                              counted(rows, "row"));
  }
  columns.note_missing();
  for (std::size_t i = 0; i < readers.size(); ++i) {
    const std::string& name = header.names[wanted[i]];
    if (readers[i].is_ambiguous())
      recording.notes.push_back("column " + in_quotes(name) +
                                ": commas are read as decimal marks; if they divide thousands, "
                                "save the file without them");
    if (!header.remarks.empty() && !header.remarks[wanted[i]].empty())
      recording.notes.push_back("column " + in_quotes(name) + ": " + header.remarks[wanted[i]]);
  }
  fill_absent(recording);
  return recording;
}

}  // namespace servotwin
