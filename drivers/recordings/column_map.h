// Assigns the columns of a file to channels of axes, by the names in its header, or by
// ReadOptions::columns for a foreign file. Any thread. Errors: as
// drivers/recordings/recording_file.h.
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/common/units.h"
#include "drivers/recordings/recording_file.h"
#include "twin/sample.h"

namespace servotwin {

/// The channels that a recording keeps.
enum class Channel { kCommand, kActual, kActualMotor, kTorque };

[[nodiscard]] std::vector<double>& values_of(AxisRecord& axis, Channel channel);

/// Which column is read as which channel. `axes` have names and units, but no values yet.
struct Layout {
  struct Column {
    std::size_t index = 0;  ///< in the file, from 0
    std::string name;       ///< name of the channel, "X.command"
    std::size_t axis = 0;
    Channel channel = Channel::kCommand;
    Unit unit;
  };
  std::optional<std::size_t> time;  ///< absent: rows come at a constant rate
  Unit time_unit;
  std::vector<Column> columns;
  std::vector<AxisRecord> axes;
  std::vector<std::string> notes;
};

/// Finds the columns. `source` begins every message. `rate_hz` is what the file itself says; it
/// counts where there is neither a time column nor ReadOptions::rate_hz. `unclear_rates`: where the
/// file may say it, for the message.
[[nodiscard]] Layout lay_out(const std::string& source, std::span<const std::string> names,
                             const ReadOptions& options, std::optional<double> rate_hz = {},
                             std::span<const std::string> unclear_rates = {});

/// Throws std::invalid_argument if the rate or the range of time in `options` is invalid.
void check(const ReadOptions& options);

/// True if only a part of the file is wanted.
[[nodiscard]] bool selects_part(const ReadOptions& options) noexcept;

/// Throws std::runtime_error that there are no rows: the file is empty, or the range is outside of
/// the recording.
[[noreturn]] void throw_no_rows(const std::string& source, double recorded_s,
                                const ReadOptions& options);

/// Gives every axis its position channels: one NaN per row where the file has no such column.
void fill_absent(Recording& recording);

}  // namespace servotwin
