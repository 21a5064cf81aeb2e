// Completion scripts for the shells, written from the option tables: commands, the options of each,
// the values of an option with a fixed set of them, and files where a file is wanted.
// The scripts are self-contained and start no program. Throws nothing; one thread.
#pragma once

#include <string>

#include "cli/program/usage.h"

namespace servotwin::cli {

/// For bash 4 or later. File names are completed by readline, which handles ~ and blanks.
[[nodiscard]] std::string bash_completion(const Usage& program);
/// For zsh: a file that is found through $fpath, or that is sourced after compinit.
[[nodiscard]] std::string zsh_completion(const Usage& program);
/// For fish 3.
[[nodiscard]] std::string fish_completion(const Usage& program);

}  // namespace servotwin::cli
