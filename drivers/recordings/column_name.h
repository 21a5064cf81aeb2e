// What the name of a column in a file says: a name and, in brackets or parentheses, a unit.
// Any thread; errors: none.
#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "drivers/common/units.h"

namespace servotwin {

/// "NAME[unit]" or "NAME (unit)": the unit is in the last pair of brackets; a name may have
/// brackets of its own, and parentheses only hold a unit that is known.
struct ColumnName {
  std::string name;
  std::optional<std::string> unit;
};
[[nodiscard]] ColumnName column_name(std::string_view text);

/// Letters of ASCII only.
[[nodiscard]] std::string lower_case(std::string text);

/// The unit of a column if it is a time by its name: t, time, t_s, time_ms, time[s] and the like;
/// `bare`: it has none.
struct TimeName {
  Unit unit;
  bool bare = false;
};
[[nodiscard]] std::optional<TimeName> time_by_name(const std::string& name);

}  // namespace servotwin
