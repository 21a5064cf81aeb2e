#include "cli/program/usage.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>

namespace servotwin::cli {
namespace {

/// The texts of an option's validators: "{a,b}", "POSITIVE", "INT in [0 - 230]".
std::vector<std::string> rules_of(CLI::Option& option) {
  std::vector<std::string> rules;
  for (int index = 0;; ++index) {
    try {
      const std::string rule = option.get_validator(index)->get_description();
      if (!rule.empty()) rules.push_back(rule);
    } catch (const CLI::OptionNotFound&) {
      return rules;
    }
  }
}

bool is_choice(const std::string& rule) {
  return rule.size() > 2 && rule.front() == '{' && rule.back() == '}';
}

/// "INT in [0 - 230]" in words.
std::string in_words(const std::string& rule) {
  if (rule == "POSITIVE") return "greater than 0";
  if (rule == "NONNEGATIVE") return "0 or more";
  const std::size_t open = rule.find(" in ["), dash = rule.find(" - ");
  if (open == rule.npos || dash == rule.npos || rule.back() != ']') return rule;
  const std::size_t low = open + 5, high = dash + 3;
  return rule.substr(low, dash - low) + " to " + rule.substr(high, rule.size() - 1 - high);
}

/// Whether the name of a value has the ending of a file, as in "OUT.json".
bool has_file_ending(const std::string& value) {
  const std::size_t dot = value.rfind('.');
  return dot != value.npos && dot > 0 && dot + 1 < value.size() &&
         std::all_of(value.begin() + static_cast<std::ptrdiff_t>(dot) + 1, value.end(),
                     [](unsigned char c) { return std::islower(c) != 0; });
}

ValueKind value_kind_of(const Argument& argument, bool positional) {
  if (argument.value.empty() && !positional) return ValueKind::kNone;
  if (!argument.choices.empty()) return ValueKind::kChoice;
  if (argument.value == "DIR") return ValueKind::kDirectory;
  if (positional || has_file_ending(argument.value)) return ValueKind::kFile;
  for (const char* file : {"OUT", "FILE", "BASE", "REC", "TEXT"}) {
    if (argument.value == file) return ValueKind::kFile;
  }
  return ValueKind::kOther;
}

Argument argument_of(CLI::Option& option, const std::vector<std::string>& commands) {
  Argument argument;
  const bool positional = option.get_positional();
  if (positional) {
    argument.names.push_back(option.get_name(true, false));
  } else {
    for (const std::string& name : option.get_snames()) argument.names.push_back("-" + name);
    for (const std::string& name : option.get_lnames()) argument.names.push_back("--" + name);
  }
  argument.description = option.get_description();
  if (option.get_type_size() != 0) {
    argument.value = option.get_type_name();
    for (const std::string& rule : rules_of(option)) {
      const std::string shown = ":" + rule;
      if (argument.value.ends_with(shown) ||
          argument.value.find(shown + ":") != argument.value.npos) {
        argument.value.erase(argument.value.find(shown), shown.size());
      }
      if (is_choice(rule)) {
        argument.choices = CLI::detail::split(rule.substr(1, rule.size() - 2), ',');
      } else {
        argument.range += (argument.range.empty() ? "" : ", ") + in_words(rule);
      }
    }
    if (argument.value == "COMMAND") argument.choices = commands;
    argument.value_optional = option.get_items_expected_min() == 0;
  }
  for (const CLI::Option* other : option.get_needs()) argument.needs.push_back(other->get_name());
  std::sort(argument.needs.begin(), argument.needs.end());  // CLI11 sorts them by address
  argument.comma_separated = option.get_delimiter() == ',';
  argument.many_values = option.get_expected_max() >= CLI::detail::expected_max_vector_size;
  argument.repeats =
      argument.many_values || option.get_multi_option_policy() == CLI::MultiOptionPolicy::TakeAll;
  argument.required = option.get_required();
  argument.kind = value_kind_of(argument, positional);
  return argument;
}

/// The commands that --help shows; one without a group is hidden.
std::vector<CLI::App*> visible_commands(CLI::App& app) {
  return app.get_subcommands([](CLI::App* command) { return !command->get_group().empty(); });
}

Usage usage_of_one(CLI::App& app, const std::vector<std::string>& commands) {
  Usage usage{app.get_name(), app.get_group(), app.get_description(), {}, {}, {}};
  for (CLI::Option* option : app.get_options([](CLI::Option*) { return true; })) {
    if (option->get_group().empty()) continue;
    (option->get_positional() ? usage.positionals : usage.options)
        .push_back(argument_of(*option, commands));
  }
  return usage;
}

}  // namespace

Usage usage_of(CLI::App& app) {
  std::vector<std::string> names;
  for (const CLI::App* command : visible_commands(app)) names.push_back(command->get_name());
  Usage program = usage_of_one(app, names);
  for (CLI::App* command : visible_commands(app)) {
    program.commands.push_back(usage_of_one(*command, names));
  }
  // --help shows a group as a whole where its first command is.
  const std::vector<std::string> groups = groups_of(program);
  const auto place = [&](const Usage& command) {
    return std::find(groups.begin(), groups.end(), command.group);
  };
  std::stable_sort(program.commands.begin(), program.commands.end(),
                   [&](const Usage& a, const Usage& b) { return place(a) < place(b); });
  return program;
}

std::vector<std::string> groups_of(const Usage& program) {
  std::vector<std::string> groups;
  for (const Usage& command : program.commands) {
    if (std::find(groups.begin(), groups.end(), command.group) == groups.end()) {
      groups.push_back(command.group);
    }
  }
  return groups;
}

std::string joined(const std::vector<std::string>& parts, const std::string& between) {
  std::string out;
  for (const std::string& part : parts) out += (out.empty() ? "" : between) + part;
  return out;
}

}  // namespace servotwin::cli
