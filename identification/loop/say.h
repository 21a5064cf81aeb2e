// Words and numbers in one line, numbers to four digits.
#pragma once

#include <sstream>
#include <string>

namespace servotwin {

template <class... Parts>
[[nodiscard]] std::string say(const Parts&... parts) {
  std::ostringstream out;
  out.precision(4);
  (out << ... << parts);
  return out.str();
}

}  // namespace servotwin
