// What the option tables of a program say: its commands, and the arguments and options of each. The
// manual pages and the completions are written from this, so they name what --help names.
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

namespace servotwin::cli {

/// What may be typed as a value.
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
  std::string value;  ///< how --help calls the value: "X", "OUT.json"
  std::vector<std::string> choices;
  std::string description;
  std::string range;               ///< "0 to 230"; empty: any value
  std::vector<std::string> needs;  ///< options that have to be given with it
  bool value_optional = false;
  bool comma_separated = false;  ///< several values may be joined by commas
  bool many_values = false;      ///< several may follow the name, as words
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

/// Reads the table of a program. Not const: CLI11 gives a validator only of an option that may be
/// changed; nothing is.
[[nodiscard]] Usage usage_of(CLI::App& app);

/// The headings of the commands, in the order of --help.
[[nodiscard]] std::vector<std::string> groups_of(const Usage& program);

}  // namespace servotwin::cli
