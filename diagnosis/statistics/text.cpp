#include "diagnosis/statistics/text.h"

#include <cctype>
#include <cstdlib>

namespace servotwin {

std::string without_powers(std::string text) {
  const auto of_number = [](char c) {
    return std::isdigit(static_cast<unsigned char>(c)) != 0 || c == '.';
  };
  for (std::size_t at = 0; (at = text.find("e+0", at)) != std::string::npos; ++at) {
    constexpr std::size_t kPower = 4;  // characters of "e+03"
    const char power = at + 3 < text.size() ? text[at + 3] : '0';
    std::size_t begin = at;
    while (begin > 0 && of_number(text[begin - 1])) --begin;
    if (begin == at || power < '2' || power > '4') continue;
    std::array<char, 32> digits{};
    std::snprintf(digits.data(), digits.size(), "%.0f",
                  std::strtod(text.substr(begin, at - begin + kPower).c_str(), nullptr));
    text.replace(begin, at - begin + kPower, digits.data());
    at = begin;
  }
  return text;
}

}  // namespace servotwin
