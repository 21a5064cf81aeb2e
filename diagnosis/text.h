// Text for people: numbers in a format, and what HTML and SVG need escaped.
#pragma once

#include <array>
#include <cstdio>
#include <string>

namespace servotwin {

/// As printf, up to 511 characters.
template <class... T>
[[nodiscard]] std::string text(const char* format, T... values) {
  std::array<char, 512> buffer{};
  std::snprintf(buffer.data(), buffer.size(), format, values...);
  return buffer.data();
}

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
