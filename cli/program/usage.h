// The option tables of a program as data: its commands, and the arguments and options of each.
// Manual pages and completions are generated from this, so they list the same options as --help.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

namespace servotwin::cli {

/// The kind of value that an argument takes.
enum class ValueKind : std::uint8_t {
  kNone,    ///< a flag: it takes no value
  kChoice,  ///< one of Argument::choices
  kFile,
  kDirectory,
  kOther,  ///< a number, a name
};

/// An option or a positional argument.
struct Argument {
  std::vector<std::string> names;  ///< "-h", "--help"; of a positional argument "REC"
  ValueKind kind = ValueKind::kNone;
  std::string value;  ///< name of the value in --help: "X", "OUT.json"
  std::vector<std::string> choices;
  std::string description;
  std::string range;               ///< "0 to 230"; empty: any value
  std::vector<std::string> needs;  ///< options that must be given with it
  bool value_optional = false;
  bool comma_separated = false;  ///< several values may be joined by commas
  bool many_values = false;      ///< several values may follow the name, separated by blanks
  bool repeats = false;          ///< may be given more than once
  bool required = false;

  bool operator==(const Argument&) const = default;
};

/// A program, or one command of it.
struct Usage {
  std::string name;
  std::string group;    ///< the heading over a command in --help
  std::string summary;  ///< one line
  std::vector<Argument> positionals, options;
  std::vector<Usage> commands;  ///< those that --help shows, in its order
};

/// Reads the option table of a program. `app` is not const because CLI11 returns the validators of
/// a non-const option only; nothing is changed.
[[nodiscard]] Usage usage_of(CLI::App& app);

/// The headings of the commands, in the order of --help.
[[nodiscard]] std::vector<std::string> groups_of(const Usage& program);

/// The parts with this between each two.
[[nodiscard]] std::string joined(const std::vector<std::string>& parts, const std::string& between);

}  // namespace servotwin::cli
