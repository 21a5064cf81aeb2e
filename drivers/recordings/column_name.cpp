#include "drivers/recordings/column_name.h"

#include <algorithm>
#include <cctype>

#include "drivers/common/text.h"

namespace servotwin {

ColumnName column_name(std::string_view text) {
  text = trimmed(text);
  // "NAME (unit)", where that is a unit.
  if (const std::size_t open = text.rfind('(');
      open != std::string_view::npos && open > 0 && text.back() == ')') {
    const std::string_view unit = trimmed(text.substr(open + 1, text.size() - open - 2));
    if (parse_unit(unit)) return {std::string(trimmed(text.substr(0, open))), std::string(unit)};
  }
  const std::size_t open = text.rfind('[');
  if (open == std::string_view::npos || text.empty() || text.back() != ']') {
    return {std::string(text), std::nullopt};
  }
  return {std::string(trimmed(text.substr(0, open))),
          std::string(trimmed(text.substr(open + 1, text.size() - open - 2)))};
}

std::string lower_case(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](char c) {
    return static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  });
  return text;
}

std::optional<TimeName> time_by_name(const std::string& name) {
  ColumnName column = column_name(name);
  column.name = lower_case(column.name);
  const std::size_t underscore = column.name.rfind('_');
  if (!column.unit && underscore != std::string::npos) {
    column = {column.name.substr(0, underscore), column.name.substr(underscore + 1)};
  }
  const bool called_so = column.name == "t" || column.name == "time" || column.name == "zeit";
  if (!called_so && (column.name != "timestamp" || !column.unit)) return std::nullopt;
  const auto unit = parse_unit(column.unit.value_or("s"));
  if (!unit || unit->quantity != Quantity::kTime) return std::nullopt;
  return TimeName{*unit, !column.unit};
}

}  // namespace servotwin
