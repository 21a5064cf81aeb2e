// Motions and a known axis, and their tables and files, as input for the tests of the tool.
#pragma once

#include <functional>
#include <string>

#include "identification/model/model_file.h"

namespace servotwin {

/// An order-2 axis with friction and a constant force, at 1 kHz.
[[nodiscard]] ModelRecord known_axis(const std::string& name = "X");

void write_model(const std::string& file, const ModelRecord& record);

/// 12 s there and back, fast and slow, from rest to rest [m]; long enough to identify from.
[[nodiscard]] double rich_motion(double t);

/// A table of commands "time[s],X.command[mm]" at 1 kHz.
[[nodiscard]] std::string command_table(double seconds = 12.0,
                                        const std::function<double(double)>& motion = rich_motion);

/// A recording "time[s],X.command[mm],X.actual[mm]" whose cells are given row by row.
[[nodiscard]] std::string recording(int rows, const std::function<std::string(int)>& command,
                                    const std::function<std::string(int)>& actual);
/// The cell of a number.
[[nodiscard]] std::string cell(double value);

}  // namespace servotwin
