// Lines that recorders write above the header of a table, and what they say about the sampling.
//
//   Device;DL850
//   Sampling interval;0,001;s        also: Sample rate: 1 kHz   Abtastzeit [ms],1
//                                    empty lines
//   Time;Command;Actual              the last line of names above the rows
//   s;mm;mm                          the units of the columns, perhaps
//   0,000;1,25;1,24                  the first of several rows of numbers with as many fields; if
//                                    every row has words, of rows that go on to the end
// Any thread; errors: std::runtime_error if the file cannot be read.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace servotwin {

struct Preamble {
  char separator = ',';                       ///< of the rows
  std::size_t names_line = 0, rows_line = 0;  ///< numbers of lines, from 1: the first of the rows
  std::vector<std::string> names;
  std::vector<std::string> units;  ///< empty: there is no row of units
  std::size_t units_line = 0;
  std::optional<double> rate_hz;  ///< absent: not said, not clear, or lines contradict each other
  /// "line 2, 'Sampling interval;0,001;s'": the line that gives rate_hz, else those that do not.
  std::vector<std::string> rate_lines;
};

/// The header below other lines; nothing if it is the first line, or none is found. The first line
/// is the header if it has `columns` names, each line down to the rows has as many fields, and each
/// of them has a field that is no word. 0 columns: the first line cannot be a header.
[[nodiscard]] std::optional<Preamble> find_preamble(const std::string& file, std::size_t first_line,
                                                    std::size_t columns, char separator);

/// Rows per second by a line that gives the interval or the rate of sampling, in English or German.
/// Without a unit they are s and Hz.
[[nodiscard]] std::optional<double> sampling_rate_in(std::string_view line, char separator);

}  // namespace servotwin
