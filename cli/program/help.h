// The commands about the program itself: help, version, completion, manual.
#pragma once

#include <string>

#include "cli/common/command.h"

namespace servotwin::cli {

/// The error message for a word that is not the name of a command: the most similar name, and all
/// names.
[[nodiscard]] std::string unknown_command(const CLI::App& app, const std::string& word);

}  // namespace servotwin::cli
