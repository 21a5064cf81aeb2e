// The units in which lengths and angles are shown, whatever the axis: micrometres or microradians,
// millimetres or milliradians. Values are SI: m on linear axes, rad on rotary ones. Any thread;
// errors: none.
#pragma once

#include <array>
#include <cmath>
#include <cstdio>
#include <string>

namespace servotwin {

inline constexpr double kMilli = 1e-3, kMicro = 1e-6;

/// "mm", "mrad" on a rotary axis.
[[nodiscard]] constexpr const char* milli(bool rotary) { return rotary ? "mrad" : "mm"; }

/// "um", "urad" on a rotary axis.
[[nodiscard]] constexpr const char* micro(bool rotary) { return rotary ? "urad" : "um"; }

/// A length in um or an angle in urad, with so many significant digits; 1524 um and not 1.52e+03.
/// `value`: m | rad.
[[nodiscard]] inline std::string micro_text(double value, bool rotary, int digits = 4) {
  std::array<char, 64> out{};
  const double shown = 1e6 * value;
  const bool whole = std::isfinite(shown) && std::fabs(shown) >= std::pow(10.0, digits) - 0.5;
  if (whole)
    std::snprintf(out.data(), out.size(), "%.0f %s", shown, micro(rotary));
  else
    std::snprintf(out.data(), out.size(), "%.*g %s", digits, shown, micro(rotary));
  return out.data();
}

/// The same rounded to whole nm or nrad, with at most six significant digits.
[[nodiscard]] inline std::string rounded_micro_text(double value, bool rotary) {
  std::array<char, 64> out{};
  std::snprintf(out.data(), out.size(), "%.6g %s", std::round(1e9 * value) * 1e-3, micro(rotary));
  return out.data();
}

}  // namespace servotwin
