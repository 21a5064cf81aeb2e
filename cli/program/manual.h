// A manual page for man(1), generated from the option table of a program and its hand-written text.
//
// One page for all commands: a reader searches it for an option or a word without knowing which
// command has it, and the build need not know the names of the commands. Options that several
// commands share are described once.
#pragma once

#include <string>

#include "cli/program/manual_text.h"
#include "cli/program/usage.h"

namespace servotwin::cli {

/// The page in the man macros of troff, in ASCII. `date` is that of the version, or empty.
[[nodiscard]] std::string manual_page(const Usage& program, const ManualText& text,
                                      const std::string& version, const std::string& date);

}  // namespace servotwin::cli
