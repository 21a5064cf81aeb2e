// Numbers in sentences for people. Any thread; errors: none.
#pragma once

#include <array>
#include <cstdio>
#include <string>

namespace servotwin::words {

/// Six significant digits.
[[nodiscard]] inline std::string number(double value) {
  std::array<char, 32> out{};
  std::snprintf(out.data(), out.size(), "%.6g", value);
  return out.data();
}

}  // namespace servotwin::words
