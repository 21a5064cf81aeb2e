// The options of one command, as its file declares them: name, where the value goes, what the
// option does, and then the form and the rules of the value.
//
//   OptionTable command(app, "history", "What the daemon's diagnoses said.");
//   command.option("--last", arguments->last, "how many").takes("N").between(1, 1000);
//
// A thin cover over CLI11, which is compiled in option_table.cpp alone: its header takes longer to
// compile than most commands. --help, the manual pages and the completions read the same table.
// One thread; a value that breaks a rule makes the parse in main() throw.
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace CLI {  // NOLINT(readability-identifier-naming): the name of the library
class App;
class Option;
}  // namespace CLI

namespace servotwin::cli {

/// One option; each rule returns the option, for the next one.
class TableOption {
 public:
  explicit TableOption(CLI::Option* option) : option_(option) {}

  /// How the value is shown: "N" of --last N.
  TableOption& takes(const std::string& form);
  TableOption& required(bool is_required = true);
  /// A number in this range. Unlike CLI::Range these refuse nan.
  TableOption& between(double low, double high);
  /// A whole number in this range.
  TableOption& between(int low, int high);
  TableOption& positive();
  TableOption& not_negative();
  TableOption& one_of(const std::vector<std::string>& words);
  TableOption& one_of_numbers(const std::vector<int>& numbers);
  /// Several values in one word: A,B,C.
  TableOption& comma_separated();
  /// The option may be repeated, each time with one value.
  TableOption& one_value_each_time();
  /// The value may be left out.
  TableOption& value_optional();

 private:
  CLI::Option* option_;
};

class OptionTable {
 public:
  /// A subcommand of `app`, which outlives the table.
  OptionTable(CLI::App& app, const std::string& name, const std::string& what);

  /// `name`: "--axis", or "RECORDING" for a positional. `value` outlives the parse. T: int, double,
  /// std::string, std::filesystem::path and the others that option_table.cpp instantiates.
  template <class T>
  TableOption option(const std::string& name, T& value, const std::string& what);
  TableOption flag(const std::string& name, bool& value, const std::string& what);
  /// For values with a form of their own; `read` may throw.
  TableOption option_read_by(const std::string& name,
                             const std::function<void(const std::string&)>& read,
                             const std::string& what);
  /// An option that was declared before.
  [[nodiscard]] TableOption declared(const std::string& name) const;
  /// Whether the command line had this option; after the parse.
  [[nodiscard]] bool given(const std::string& name) const;
  [[nodiscard]] CLI::App* app() const noexcept { return app_; }

 private:
  CLI::App* app_;
};

/// A finite number as options read it, all of `word`; nothing if it is none.
[[nodiscard]] std::optional<double> number_of(const std::string& word);
/// Refuses a value while options are parsed: "OPTION: WHY", exit status 2.
[[noreturn]] void refuse_value(const std::string& option, const std::string& why);

}  // namespace servotwin::cli
