// The header of a table, however a spreadsheet or a recorder has written it.
//
//   time[s],X.command[mm]          names with units
//   Time,Position Command          names, and a second line of units: s,mm
//   # t xcmd xact                  the names in the comment before columns divided by blanks
//   0 0.000000 0.0000              no names: columns are called 1, 2, 3
// The separator is the one of , ; tab that occurs most often, else blanks. Names that are not UTF-8
// are read as Latin-1. Lines that begin with # and empty ones are skipped. Errors:
// std::runtime_error with file and line. One thread.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/common/text_lines.h"
#include "drivers/recordings/recording_format.h"

namespace servotwin {

struct CsvHeader {
  char separator = ',';                    ///< ' ': any number of blanks and tabs
  std::vector<std::string> names;          ///< with "[unit]" where the file has one
  std::vector<std::string> notes;          ///< what was assumed, for people
  std::optional<double> rate_hz;           ///< rows per second, where the file says it
  std::string rate_note;                   ///< where it says it; empty: a note says it already
  std::vector<std::string> unclear_rates;  ///< lines about the sampling that do not give rate_hz
  // Of controllers' traces (drivers/recordings):
  std::vector<std::size_t> time_of;  ///< of every column the column of its times [ms]; empty: one
                                     ///< time for all
  std::vector<double> step_ms, begins_ms;  ///< their sampling and first times; NaN: not known
  std::vector<std::string> remarks;        ///< of every column, for who reads it; empty: none
  std::string ends_with;                   ///< a line behind the last row
};

/// Reads it; the next line of `lines` is the first row. `named`: kTable or a trace that is a table.
[[nodiscard]] CsvHeader read_csv_header(TextLines& lines, const std::string& source,
                                        std::optional<RecordingFormat> named = {});

/// The separator of a line; blanks if there is none. In a row of numbers commas may be decimal
/// marks.
[[nodiscard]] char separator_of(std::string_view line);

/// The fields of a line: split_fields(), or what blanks divide.
[[nodiscard]] std::vector<std::string> fields_of(std::string_view line, char separator);

/// Whether these are values and not names: numbers, stamps of time and missing values.
[[nodiscard]] bool is_row(const std::vector<std::string>& fields);

/// Whether these cells are the units of the columns above them: at least one is, and none is a
/// value.
[[nodiscard]] bool is_row_of_units(const std::vector<std::string>& cells);

/// UTF-8 as it is; other bytes are taken for Latin-1.
[[nodiscard]] std::string utf8_of(const std::string& text);

/// Whether this cell is a value that can be read as a number.
[[nodiscard]] bool is_number(std::string_view cell);

/// Whether this cell says that there is no value: N/A and the like.
[[nodiscard]] bool is_missing_word(std::string_view cell);

/// Whether a line has no row: empty, or a comment.
[[nodiscard]] bool is_csv_comment(std::string_view line);

/// Whether this text, the beginning of a file, could be a table: its first line has a separator, or
/// is that of a trace.
[[nodiscard]] bool is_table(std::string_view start);

}  // namespace servotwin
