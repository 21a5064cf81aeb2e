// What the repairs of a recording share: values of a channel, and how they are written.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <iterator>
#include <numbers>
#include <string>
#include <vector>

#include "twin/sample.h"

namespace servotwin::values {

using Values = std::vector<double>;

/// Six significant digits.
inline std::string number(double value) {
  std::array<char, 32> out{};
  std::snprintf(out.data(), out.size(), "%.6g", value);
  return out.data();
}

/// In the unit that people read.
inline std::string size_text(double value, bool rotary) {
  return rotary ? number(value * 180.0 / std::numbers::pi) + " deg" : number(1e3 * value) + " mm";
}

inline Values finite(const Values& values) {
  Values out;
  std::copy_if(values.begin(), values.end(), std::back_inserter(out),
               [](double v) { return std::isfinite(v); });
  return out;
}

/// Greatest less least of the finite values; 0 if there are none.
inline double range_of(const Values& values) {
  double low = HUGE_VAL, high = -HUGE_VAL;
  for (const double value : values) {
    if (!std::isfinite(value)) continue;
    low = std::min(low, value), high = std::max(high, value);
  }
  return high > low ? high - low : 0.0;
}

/// The command at the row before (`by` -1) or after (1); where it is absent, as the other side and
/// this row would have it in a straight line.
inline double command_beside(const AxisRecord& axis, std::size_t row, int by) {
  const auto at = [&](int offset) {
    const std::size_t beside = row + static_cast<std::size_t>(offset);  // before row 0: none
    return beside < axis.command.size() ? axis.command[beside] : kAbsent;
  };
  const double here = axis.command[row];
  if (std::isfinite(at(by))) return at(by);
  return std::isfinite(at(-by)) ? 2.0 * here - at(-by) : here;
}

/// Twice the change of the command per row, which a lag multiplies.
inline double command_slope(const AxisRecord& axis, std::size_t row) {
  return command_beside(axis, row, 1) - command_beside(axis, row, -1);
}

inline double command_bend(const AxisRecord& axis, std::size_t row) {
  return command_beside(axis, row, 1) - 2.0 * axis.command[row] + command_beside(axis, row, -1);
}

}  // namespace servotwin::values
