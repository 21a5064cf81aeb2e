// Numbers in the program's JSON. JSON has no NaN: an unknown number is written as null.
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>

namespace servotwin {

/// The number, or null where it is not finite.
[[nodiscard]] inline nlohmann::json number_or_null(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
}

}  // namespace servotwin
