// Helpers for printed text: formatted numbers, and escaping for HTML and SVG. Any thread.
#pragma once

#include <array>
#include <cstdio>
#include <string>

namespace servotwin {

/// Formats as printf does; the result is cut after 511 characters.
template <class... T>
[[nodiscard]] std::string text(const char* format, T... values) {
  std::array<char, 512> buffer{};
  std::snprintf(buffer.data(), buffer.size(), format, values...);
  return buffer.data();
}

/// The unit of a length in um on a linear axis, of an angle in urad on a rotary one.
[[nodiscard]] constexpr const char* micro(bool rotary) { return rotary ? "urad" : "um"; }

/// A length in um or an angle in urad, to four digits. `value`: m | rad.
[[nodiscard]] inline std::string micro_text(double value, bool rotary) {
  return text("%.4g %s", 1e6 * value, micro(rotary));
}

/// The text with &, < and > as HTML entities.
[[nodiscard]] inline std::string escaped(const std::string& given) {
  std::string out;
  for (const char c : given) {
    if (c == '&') {
      out += "&amp;";
    } else if (c == '<') {
      out += "&lt;";
    } else if (c == '>') {
      out += "&gt;";
    } else {
      out += c;
    }
  }
  return out;
}

}  // namespace servotwin
