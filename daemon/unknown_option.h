// A message for a misspelt option, for which the parser has no better word than "not expected".
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

#include "drivers/text.h"

namespace servotwin::daemon {

/// The message for the first unknown option, with the nearest known name; empty if there is none.
[[nodiscard]] inline std::string unknown_option(const CLI::App& command) {
  for (const std::string& word : command.remaining()) {
    if (word == "--") break;  // the rest are not options
    if (word.empty() || word.front() != '-' || word.find_first_not_of('-') == word.npos) continue;
    std::vector<std::string> names;
    for (const CLI::Option* option : command.get_options()) {
      names.insert(names.end(), option->get_lnames().begin(), option->get_lnames().end());
    }
    const std::string name = word.substr(0, word.find('='));
    const std::string near = nearest_name(name.substr(name.find_first_not_of('-')), names);
    return "there is no option " + in_quotes(name) +
           (near.empty() ? "" : "; did you mean '--" + near + "'?");
  }
  return {};
}

}  // namespace servotwin::daemon
