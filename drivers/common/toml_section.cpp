#include "drivers/common/toml_section.h"

#include <algorithm>
#include <cctype>
#include <memory>
#include <optional>
#include <sstream>

#include "drivers/common/messages.h"
#include "drivers/common/text.h"

namespace servotwin {
namespace {

std::string bounds(double lower, double upper, const std::string& unit) {
  return number(lower) + " to " + number(upper) + (unit.empty() ? "" : " " + unit);
}

}  // namespace

namespace {

/// The end of a text in quotes that begins at `at`, behind its quotes. In a text without an end,
/// the parser's own error comes first.
std::size_t end_of_quoted(std::string_view text, std::size_t at) {
  const char quote = text[at];
  const std::string three(3, quote);
  const bool lines = text.substr(at).starts_with(three);
  for (at += lines ? 3 : 1; at < text.size(); ++at) {
    if (quote == '"' && text[at] == '\\') {
      ++at;
    } else if (lines && text.substr(at).starts_with(three)) {
      at += 3;  // up to two quotes before the last three belong to the text
      for (int more = 0; more < 2 && at < text.size() && text[at] == quote; ++more) ++at;
      return at;
    } else if (!lines && (text[at] == quote || text[at] == '\n')) {
      return at + 1;
    }
  }
  return text.size();
}

/// The place of the first key with more than kMaxKeyParts parts; none: text.size().
std::size_t place_of_long_key(std::string_view text) {
  int parts = 1;
  for (std::size_t at = 0; at < text.size();) {
    const char c = text[at];
    if (c == '"' || c == '\'') {
      at = end_of_quoted(text, at);
      continue;
    }
    if (c == '#') {
      at = std::min(text.find('\n', at), text.size());
      continue;
    }
    if (c == '.' && ++parts > kMaxKeyParts) return at;
    if (std::string_view("\n=,[]{}").find(c) != std::string_view::npos) parts = 1;
    ++at;
  }
  return text.size();
}

}  // namespace

toml::table parse_toml(std::string_view text, const std::string& name) {
  if (const std::size_t at = place_of_long_key(text); at < text.size()) {
    const std::string_view before = text.substr(0, at);
    const auto line = std::count(before.begin(), before.end(), '\n') + 1;
    const std::size_t column = at - (before.rfind('\n') + 1) + 1;  // npos + 1: 0
    throw toml::parse_error(("a key has more than " + std::to_string(kMaxKeyParts) +
                             " parts; the keys of this program have at most four")
                                .c_str(),
                            toml::source_position{static_cast<toml::source_index>(line),
                                                  static_cast<toml::source_index>(column)},
                            std::make_shared<const std::string>(name));
  }
  return toml::parse(text, name);
}

std::string ConfigProblem::message() const {
  const std::string place =
      line == 0 ? "" : ":" + std::to_string(line) + ":" + std::to_string(column);
  return file + place + ": " + what;
}

std::string messages(std::span<const ConfigProblem> problems) {
  std::string all;
  for (const ConfigProblem& problem : problems) {
    if (!all.empty()) all += '\n';
    all += problem.message();
  }
  return all;
}

void Problems::add(const toml::source_region& where, std::string what) {
  // One line each: the parser's message may contain the end of the line.
  std::replace_if(
      what.begin(), what.end(), [](unsigned char c) { return std::iscntrl(c) != 0; }, ' ');
  found_.push_back({file_, static_cast<int>(where.begin.line), static_cast<int>(where.begin.column),
                    std::move(what)});
}

void Problems::add(const std::string& key, const toml::node& value, const std::string& rule) {
  if (value.is_table()) {
    add(value.source(), key + ": " + rule);
    return;
  }
  std::ostringstream shown;
  value.visit([&](const auto& node) { shown << node; });
  add(value.source(), key + " = " + shown.str() + ": " + rule);
}

void Problems::sort() {
  std::stable_sort(found_.begin(), found_.end(),
                   [](const ConfigProblem& a, const ConfigProblem& b) {
                     return a.line != b.line ? a.line < b.line : a.column < b.column;
                   });
}

const toml::node* Section::find(const std::string& key) {
  known_.push_back(key);
  return table_ == nullptr ? nullptr : table_->get(key);
}

Section Section::section(const std::string& key) {
  const toml::node* node = find(key);
  if (node != nullptr && !node->is_table()) report(key, "must be a table: [" + name_of(key) + "]");
  return {node == nullptr ? nullptr : node->as_table(), name_of(key), problems_};
}

void Section::number(const std::string& key, double lower, double upper, const std::string& unit,
                     double& to) {
  const toml::node* node = find(key);
  if (node == nullptr) return;
  const auto value = node->is_number() ? node->value<double>() : std::nullopt;
  if (value && *value >= lower && *value <= upper) {
    to = *value;
  } else {
    report(key, "must be a number from " + bounds(lower, upper, unit));
  }
}

void Section::integer(const std::string& key, int lower, int upper, int& to) {
  const toml::node* node = find(key);
  if (node == nullptr) return;
  const auto value = node->is_integer() ? node->value<std::int64_t>() : std::nullopt;
  if (value && *value >= lower && *value <= upper) {
    to = static_cast<int>(*value);
  } else {
    report(key, "must be a whole number from " + bounds(lower, upper, ""));
  }
}

void Section::integers(const std::string& key, int lower, int upper, std::vector<int>& to) {
  const toml::node* node = find(key);
  if (node == nullptr) return;
  const toml::array* list = node->as_array();
  std::vector<int> values;
  bool good = list != nullptr;
  for (std::size_t i = 0; good && i < list->size(); ++i) {
    const auto value = (*list)[i].is_integer() ? (*list)[i].value<std::int64_t>() : std::nullopt;
    good = value && *value >= lower && *value <= upper;
    if (good) values.push_back(static_cast<int>(*value));
  }
  if (good) {
    to = std::move(values);
  } else {
    report(key, "must be a list of whole numbers from " + bounds(lower, upper, ""));
  }
}

void Section::flag(const std::string& key, bool& to) {
  const toml::node* node = find(key);
  if (node == nullptr) return;
  if (const auto value = node->value_exact<bool>()) {
    to = *value;
  } else {
    report(key, "must be true or false");
  }
}

void Section::text(const std::string& key, std::size_t shortest, std::size_t longest,
                   std::string& to) {
  const toml::node* node = find(key);
  if (node == nullptr) return;
  const auto value = node->value_exact<std::string>();
  if (value && value->size() >= shortest && value->size() <= longest) {
    to = *value;
  } else {
    report(key, "must be a text of " + std::to_string(shortest) + " to " + std::to_string(longest) +
                    " characters in quotes");
  }
}

void Section::name(const std::string& key, std::size_t longest, std::string& to) {
  const toml::node* node = find(key);
  if (node == nullptr) return;
  const auto value = node->value_exact<std::string>();
  if (value && value->size() <= longest && usable_name(*value)) {
    to = *value;
  } else {
    report(key, "must be 1 to " + std::to_string(longest) +
                    " letters, digits or any of . _ -, not beginning with a dot");
  }
}

void Section::one_of(const std::string& key, const std::vector<std::string>& allowed,
                     std::string& to) {
  const toml::node* node = find(key);
  if (node == nullptr) return;
  const auto value = node->value_exact<std::string>();
  if (value && std::find(allowed.begin(), allowed.end(), *value) != allowed.end()) {
    to = *value;
  } else {
    std::string list;
    for (const std::string& one : allowed) list += (list.empty() ? "'" : ", '") + one + "'";
    report(key, "must be one of " + list);
  }
}

void Section::range(const std::string& key, double lower, double upper, const std::string& unit,
                    double& from, double& to) {
  const toml::node* node = find(key);
  if (node == nullptr) return;
  const toml::array* pair = node->as_array();
  std::optional<double> a, b;
  if (pair != nullptr && pair->size() == 2 && (*pair)[0].is_number() && (*pair)[1].is_number()) {
    a = (*pair)[0].value<double>();
    b = (*pair)[1].value<double>();
  }
  if (a && b && *a >= lower && *b <= upper && *a < *b) {
    from = *a;
    to = *b;
  } else {
    report(key, "must be [lowest, highest] within " + bounds(lower, upper, unit));
  }
}

void Section::report(const std::string& key, const std::string& rule) {
  const toml::node* node = table_->get(key);
  if (node == nullptr) return report_missing(key, rule);
  problems_.add(name_of(key), *node, rule);
}

void Section::report_secret(const std::string& key, const std::string& rule) {
  problems_.add(table_->get(key)->source(), name_of(key) + ": " + rule);
}

void Section::report_missing(const std::string& key, const std::string& why) {
  problems_.add(table_->source(), name_of(key) + ": " + why);
}

void Section::refuse_unknown() const {
  if (table_ == nullptr) return;
  for (const auto& [key, node] : *table_) {
    const std::string name(key.str());
    if (std::find(known_.begin(), known_.end(), name) != known_.end()) continue;
    problems_.add(key.source(),
                  name_of(name) + ": there is no such key" + did_you_mean(name, known_));
  }
}

}  // namespace servotwin
