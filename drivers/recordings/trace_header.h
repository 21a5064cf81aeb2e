// Headers of controllers' traces that are tables: which format it is, and what its columns are.
// Errors: std::runtime_error with file and line. One thread.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "drivers/common/text_lines.h"
#include "drivers/recordings/recording_format.h"
#include "drivers/recordings/table/csv_header.h"

namespace servotwin {

/// The header of the trace that begins with this line, which `lines` has just returned; the next
/// line is then the first row. Nothing if it is no known format. Refused if it is not that of
/// `named`.
[[nodiscard]] std::optional<CsvHeader> read_trace_header(TextLines& lines, const std::string& first,
                                                         std::optional<RecordingFormat> named);

/// Whether a trace begins with this line that has no separator of a table.
[[nodiscard]] bool is_trace(std::string_view first) noexcept;

/// "AXIS.channel[unit]"; without the unit if it is none that the program knows.
[[nodiscard]] std::string column_name(const std::string& name, std::string_view unit);

}  // namespace servotwin
