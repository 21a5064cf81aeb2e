#include "drivers/common/text.h"

#include <algorithm>
#include <cctype>
#include <charconv>
#include <numeric>

namespace servotwin {

std::string_view trimmed(std::string_view text) noexcept {
  const std::size_t begin = text.find_first_not_of(kBlanks);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kBlanks) - begin + 1);
}

std::vector<std::string> split_fields(std::string_view line, char separator) {
  std::vector<std::string> fields(1);
  bool inside = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (line[i] == '"') {
      const bool doubled = inside && i + 1 < line.size() && line[i + 1] == '"';
      if (doubled) {
        fields.back() += '"';
        ++i;
      } else {
        inside = !inside;
      }
    } else if (line[i] == separator && !inside) {
      fields.emplace_back();
    } else {
      fields.back() += line[i];
    }
  }
  for (std::string& field : fields) field = std::string(trimmed(field));
  return fields;
}

std::string in_quotes(std::string_view text) {
  constexpr std::size_t kMaxCharacters = 40;
  std::string shown = "'";
  for (const char c : text.substr(0, kMaxCharacters)) {
    const auto byte = static_cast<unsigned char>(c);
    shown += byte < 0x20 || byte == 0x7f ? '?' : c;
  }
  // A character of several bytes must not be cut in the middle.
  if (text.size() > kMaxCharacters) {
    while (shown.size() > 1 && (static_cast<unsigned char>(shown.back()) & 0x80U) != 0) {
      shown.pop_back();
    }
    shown += "...";
  }
  return shown + "'";
}

std::string in_one_line(std::string name) {
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return c < ' '; }, '?');
  return name;
}

std::string listed(std::span<const std::string> names) {
  std::string list;
  for (const std::string& name : names) list += (list.empty() ? "" : ", ") + name;
  return list;
}

std::string counted(std::size_t count, std::string_view one) {
  return std::to_string(count) + " " + std::string(one) + (count == 1 ? "" : "s");
}

std::string number(double value) {
  char digits[32];
  const auto end =
      std::to_chars(digits, digits + sizeof digits, value, std::chars_format::general, 6);
  return {digits, end.ptr};
}

std::string nearest_name(std::string_view name, std::span<const std::string> names) {
  const auto lower = [](char c) { return std::tolower(static_cast<unsigned char>(c)); };
  std::string nearest;
  std::size_t fewest = name.size() / 2 + 1;
  std::vector<std::size_t> row;
  for (const std::string& candidate : names) {
    // Levenshtein's distance, one row at a time; upper and lower case count as the same letter.
    row.resize(candidate.size() + 1);
    std::iota(row.begin(), row.end(), std::size_t{0});
    for (std::size_t i = 0; i < name.size(); ++i) {
      std::size_t diagonal = row[0];
      row[0] = i + 1;
      for (std::size_t j = 0; j < candidate.size(); ++j) {
        const std::size_t change = diagonal + (lower(name[i]) != lower(candidate[j]) ? 1 : 0);
        diagonal = row[j + 1];
        row[j + 1] = std::min({change, row[j] + 1, row[j + 1] + 1});
      }
    }
    if (row.back() < fewest) {
      fewest = row.back();
      nearest = candidate;
    }
  }
  return nearest;
}

std::string did_you_mean(std::string_view name, std::span<const std::string> names) {
  const std::string nearest = nearest_name(name, names);
  return nearest.empty() ? std::string(".") : "; did you mean " + in_quotes(nearest) + "?";
}

}  // namespace servotwin
