// The sections of a manual page that are written by hand, beside those generated from the option
// table.
#pragma once

#include <string>
#include <vector>

namespace servotwin::cli {

/// A term and what it means: a file, a variable, an exit status.
struct ManualEntry {
  std::string term, meaning;
};

/// A command line, and what it is for.
struct ManualExample {
  std::string purpose, line;
};

struct ManualSection {
  std::string title;
  std::vector<std::string> paragraphs;
  std::vector<ManualEntry> entries;
  std::vector<ManualExample> examples;
};

struct ManualText {
  int section = 1;                           ///< of the manual
  std::string book;                          ///< "User Commands"
  std::string title;                         ///< what follows the name in NAME
  std::vector<ManualSection> before, after;  ///< the sections around commands and options
  std::vector<std::string> see_also;         ///< "servotwind(8)"
};

[[nodiscard]] ManualText servotwin_manual_text();
[[nodiscard]] ManualText servotwind_manual_text();

}  // namespace servotwin::cli
