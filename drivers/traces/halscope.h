// LinuxCNC halscope, the log that it writes with names and values in turns.
//
//   Sampling period is 100000 nSec
//
//   joint.3.motor-pos-cmd +7,92000000061527 joint.3.motor-pos-fb +7,91950000000000
//
// Decimal marks follow the locale. The file has no units: --columns gives them. Source: LinuxCNC,
// src/hal/utils/scope_files.c, and a log of daiman444/log_halscope.
#pragma once

#include <string_view>

#include "drivers/csv_header.h"
#include "drivers/text_lines.h"

namespace servotwin {

[[nodiscard]] inline bool is_halscope(std::string_view first) noexcept {
  return first.starts_with("Sampling period is ");
}
[[nodiscard]] CsvHeader read_halscope_header(TextLines& lines, std::string_view first);

}  // namespace servotwin
