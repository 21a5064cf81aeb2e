// A problem in a configuration file, with its place. Any thread; errors: none.
#pragma once

#include <span>
#include <string>

namespace servotwin {

struct ConfigProblem {
  std::string file;
  int line = 0, column = 0;  ///< from 1; 0: the file as a whole
  std::string what;          ///< key, value, rule and what to do

  /// "file:line:column: what"
  [[nodiscard]] std::string message() const;
};

/// All of them, one per line.
[[nodiscard]] std::string messages(std::span<const ConfigProblem> problems);

}  // namespace servotwin
