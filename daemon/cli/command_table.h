// A table of commands and the models of its axes: what `simulate` and `learn` work on.
#pragma once

#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include "daemon/cli/options.h"

namespace servotwin::cli {

struct ModelFile {
  std::filesystem::path file;
  ModelRecord record;
};

/// The models, one per axis; throws UsageError for two of one axis.
[[nodiscard]] std::vector<ModelFile> read_models(const std::vector<std::filesystem::path>& files);

/// One axis of the table with its model, at the rate of the table.
struct CommandedAxis {
  ModelRecord record;
  Model model;
  Segment path;  ///< without encoder and torque
};

/// The commands of every axis that has a model, over the same rows. What of the table is left out
/// ("note: not DONE: ..") and what was repaired is said on `people`. Throws std::runtime_error for
/// a path that breaks off, axes that the table has not, models of another kind.
[[nodiscard]] std::vector<CommandedAxis> read_commands(const RecordingOptions& path,
                                                       const std::vector<ModelFile>& models,
                                                       const std::string& done, std::FILE* people);

/// The times of a path's rows, as the first column of a table.
[[nodiscard]] std::vector<double> times_of(const Segment& path);

}  // namespace servotwin::cli
