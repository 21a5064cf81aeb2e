// What the program says of itself beside --help: help, version, completion, manual.
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "cli/command.h"

namespace servotwin::cli {

/// For a word that should be the name of a command and is none: which there are, and the nearest.
[[nodiscard]] std::string unknown_command(const CLI::App& app, const std::string& word);

}  // namespace servotwin::cli
