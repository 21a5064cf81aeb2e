// The tables of a TOML file as sections that hand out their keys: a wrong type, a value out of its
// range or a key that does not exist is a problem with its place, and reading continues with the
// other keys. One thread; errors: none, problems are collected.
#pragma once

#include <toml++/toml.h>

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/common/config_problem.h"

namespace servotwin {

/// toml::parse() for files that may be hostile: throws toml::parse_error as well if a key has more
/// than kMaxKeyParts parts. Every part is a table in the one before it; tables are read, copied and
/// destroyed by recursion, for which a long key has no stack.
[[nodiscard]] toml::table parse_toml(std::string_view text, const std::string& name);
inline constexpr int kMaxKeyParts = 32;  // our longest keys have four

/// The problems of one file, as they are found.
class Problems {
 public:
  Problems(std::string file, std::vector<ConfigProblem>& found)
      : file_(std::move(file)), found_(found) {}

  void add(const toml::source_region& where, std::string what);
  void add(const std::string& key, const toml::node& value, const std::string& rule);
  /// Sorts the problems by their place in the file.
  void sort();

 private:
  std::string file_;
  std::vector<ConfigProblem>& found_;
};

/// One table of the file: returns its keys, and can refuse those that were never asked for.
class Section {
 public:
  Section(const toml::table* table, std::string path, Problems& problems)
      : table_(table), path_(std::move(path)), problems_(problems) {}

  [[nodiscard]] bool given() const { return table_ != nullptr; }
  [[nodiscard]] bool has(const std::string& key) const {
    return table_ != nullptr && table_->contains(key);
  }

  /// The value of a key, if it is there.
  const toml::node* find(const std::string& key);
  Section section(const std::string& key);
  void number(const std::string& key, double lower, double upper, const std::string& unit,
              double& to);
  void integer(const std::string& key, int lower, int upper, int& to);
  void integers(const std::string& key, int lower, int upper, std::vector<int>& to);
  void flag(const std::string& key, bool& to);
  void text(const std::string& key, std::size_t shortest, std::size_t longest, std::string& to);
  /// A text that is valid in file names, column names and messages.
  void name(const std::string& key, std::size_t longest, std::string& to);
  void one_of(const std::string& key, const std::vector<std::string>& allowed, std::string& to);
  /// [lowest, highest] of something that is searched between them.
  void range(const std::string& key, double lower, double upper, const std::string& unit,
             double& from, double& to);

  /// Reports that an existing key breaks this rule.
  void report(const std::string& key, const std::string& rule);
  /// The same without the value, which nobody must read in a log.
  void report_secret(const std::string& key, const std::string& rule);
  void report_missing(const std::string& key, const std::string& why);
  void refuse_unknown() const;
  [[nodiscard]] std::string name_of(const std::string& key) const {
    return path_.empty() ? key : path_ + "." + key;
  }

 private:
  const toml::table* table_;
  std::string path_;
  Problems& problems_;
  std::vector<std::string> known_;
};

}  // namespace servotwin
