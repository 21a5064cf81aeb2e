// Numbers in the program's JSON: there is no NaN in JSON, and what is not known is null.
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>

namespace servotwin {

/// The number, or null where it is not finite.
[[nodiscard]] inline nlohmann::json number_or_null(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
}

}  // namespace servotwin
