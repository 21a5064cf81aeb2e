// LinuxCNC halscope. Up to 2.8 it writes a log with names and values in turns:
//
//   Sampling period is 100000 nSec
//
//   joint.3.motor-pos-cmd +7,92000000061527 joint.3.motor-pos-fb +7,91950000000000
//
// with the decimal mark of the locale; from 2.9 on a table with decimal points, and after 2.9 with
// the settings of its screen in two more comments:
//
//   # Sampling period is 1000000 ns
//   joint.3.motor-pos-cmd;joint.3.motor-pos-fb
//   # Position: 0.500000;0.500000
//   # Scale: 3;3
//   7.92000000061527;7.91950000000000
//
// The files have no units: --columns gives them. Source: LinuxCNC, src/hal/utils/scope_files.c
// (v2.9.9, and master of August 2026), and a log of daiman444/log_halscope.
#pragma once

#include <optional>
#include <string_view>

#include "drivers/common/text_lines.h"
#include "drivers/recordings/table/csv_header.h"

namespace servotwin {

[[nodiscard]] inline bool is_halscope(std::string_view first) noexcept {
  return first.starts_with("Sampling period is ");
}
[[nodiscard]] CsvHeader read_halscope_header(TextLines& lines, std::string_view first);

/// Rows per second by the comment that begins a table of halscope; nothing if it is another
/// comment.
[[nodiscard]] std::optional<double> halscope_table_rate_hz(std::string_view comment);

}  // namespace servotwin
