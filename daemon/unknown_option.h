// A message for a misspelt option, for which the parser has no better word than "not expected".
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "drivers/common/text.h"

namespace servotwin::daemon {

/// "--model OUT.json, --json OUT": the options of a command that write files.
[[nodiscard]] inline std::vector<std::string> writing_options(const CLI::App& command) {
  std::vector<std::string> out;
  for (const CLI::Option* option : command.get_options()) {
    const std::string value = option->get_type_name();
    if (value.starts_with("OUT")) out.push_back(option->get_name() + " " + value);
  }
  return out;
}

/// The message for the first unknown option, with the nearest known name; empty if there is none.
[[nodiscard]] inline std::string unknown_option(const CLI::App& command) {
  for (const std::string& word : command.remaining()) {
    if (word == "--") break;  // the rest are not options
    if (word.empty() || word.front() != '-' || word.find_first_not_of('-') == word.npos) continue;
    const std::string name = word.substr(0, word.find('='));
    const std::string bare = name.substr(name.find_first_not_of('-'));
    // Of other programs; the option that does it here is not near in letters.
    for (const char* writes : {"o", "out", "output", "save", "write"}) {
      if (const std::vector<std::string> there = writing_options(command);
          bare == writes && !there.empty())
        return "there is no option " + in_quotes(name) + "; files are written by " + listed(there);
    }
    std::vector<std::string> names;
    for (const CLI::Option* option : command.get_options()) {
      names.insert(names.end(), option->get_lnames().begin(), option->get_lnames().end());
    }
    const std::string near = nearest_name(bare, names);
    return "there is no option " + in_quotes(name) +
           (near.empty() ? "" : "; did you mean '--" + near + "'?");
  }
  return {};
}

}  // namespace servotwin::daemon
