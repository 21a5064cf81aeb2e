// A table of commands and the models of its axes: what `simulate` and `learn` work on.
#pragma once

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "cli/options.h"

namespace servotwin::cli {

/// PATH, what a recording may need, and --model.
struct TableOptions {
  RecordingOptions path;
  std::vector<std::filesystem::path> models;

  void declare(CLI::App& command);
};

/// One axis of the table with its model, at the rate of the table.
struct CommandedAxis {
  ModelRecord record;
  Model model;
  Segment path;  ///< without encoder and torque
};

/// The commands of every axis that has a model, over the same rows, evenly spaced. What of the
/// table is left out ("note: not DONE: ..") and what was repaired is said on `people`. Throws
/// UsageError for two models of one axis, std::runtime_error for a path that breaks off, axes that
/// the table has not, models of another kind.
[[nodiscard]] std::vector<CommandedAxis> read_commands(const TableOptions& table,
                                                       const std::string& done, std::FILE* people);

/// The times of a path's rows, as the first column of a table.
[[nodiscard]] std::vector<double> times_of(const Segment& path);

}  // namespace servotwin::cli
