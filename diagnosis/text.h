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
