// A table of commands and the models of its axes: what `simulate` and `learn` work on.
#pragma once

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "cli/common/options.h"

namespace servotwin::cli {

class OptionTable;

/// PATH, the options of a recording, and --model.
struct TableOptions {
  RecordingOptions path;
  std::vector<std::filesystem::path> models;

  void declare(OptionTable& command);
};

/// One axis of the table with its model, at the rate of the table.
struct CommandedAxis {
  ModelRecord record;
  Model model;
  Segment path;  ///< without encoder and torque
};

/// The commands of every axis that has a model, over the same evenly spaced rows. Prints on
/// `people` which parts of the table are left out ("note: not DONE: ..") and what was repaired.
/// Throws UsageError for two models of one axis; std::runtime_error for a path with a gap, for a
/// model whose axis is not in the table, and for a model of the other kind (linear, rotary).
[[nodiscard]] std::vector<CommandedAxis> read_commands(const TableOptions& table,
                                                       const std::string& done, std::FILE* people);

/// The times of a path's rows [s], for the first column of a table.
[[nodiscard]] std::vector<double> times_of(const Segment& path);

}  // namespace servotwin::cli
