// Helpers for printed text: formatted numbers, and escaping for HTML and SVG. Any thread.
#pragma once

#include <array>
#include <cstdio>
#include <string>

namespace servotwin {

/// "1170" for the "1.17e+03" of %.3g, up to 99999: on a machine nobody reads powers of ten.
[[nodiscard]] std::string without_powers(std::string text);

/// Formats as printf does, without powers of ten from 100 to 99999; the result is cut after 511
/// characters.
template <class... T>
[[nodiscard]] std::string text(const char* format, T... values) {
  std::array<char, 512> buffer{};
  std::snprintf(buffer.data(), buffer.size(), format, values...);
  return without_powers(buffer.data());
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
