// Formats a message from words and numbers; numbers have four significant digits.
#pragma once

#include <sstream>
#include <string>

namespace servotwin {

template <class... Parts>
[[nodiscard]] std::string message(const Parts&... parts) {
  std::ostringstream out;
  out.precision(4);
  (out << ... << parts);
  return out.str();
}

}  // namespace servotwin
