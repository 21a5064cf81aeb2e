// From the names of a file's columns to channels of axes: what the header says of itself, or what
// ReadOptions::columns says of a foreign file.
// Any thread. Errors: as drivers/recording_file.h.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/recording_file.h"
#include "drivers/units.h"
#include "twin/sample.h"

namespace servotwin {

/// The channels that a recording keeps.
enum class Channel { kCommand, kActual, kTorque };

[[nodiscard]] std::vector<double>& values_of(AxisRecord& axis, Channel channel);

/// What to take from which column. `axes` have names and units and no values yet.
struct Layout {
  struct Column {
    std::size_t index = 0;  ///< in the file, from 0
    std::string name;       ///< ours, "X.command"
    std::size_t axis = 0;
    Channel channel = Channel::kCommand;
    Unit unit;
  };
  std::optional<std::size_t> time;  ///< absent: the rows come at ReadOptions::rate_hz
  Unit time_unit;
  std::vector<Column> columns;
  std::vector<AxisRecord> axes;
  std::vector<std::string> notes;
};

/// Finds the columns. `source` begins every message.
[[nodiscard]] Layout lay_out(const std::string& source, std::span<const std::string> names,
                             const ReadOptions& options);

/// Throws std::invalid_argument if an option cannot be meant: a rate or a range that is none.
void check(const ReadOptions& options);

/// True if only a part of the file is wanted.
[[nodiscard]] bool selects_part(const ReadOptions& options) noexcept;

/// Throws that no row is left, and why: an empty file, or a range beside the recording.
[[noreturn]] void throw_no_rows(const std::string& source, double recorded_s,
                                const ReadOptions& options);

/// Gives every axis its position channels: one NaN per row where the file has no such column.
void fill_absent(Recording& recording);

}  // namespace servotwin
