// Numbers in the program's JSON. JSON has no NaN: an unknown number is written as null.
#pragma once

#include <cmath>
#include <nlohmann/json.hpp>

#include "identification/recording/noise_floor.h"

namespace servotwin {

/// The number, or null where it is not finite.
[[nodiscard]] inline nlohmann::json number_or_null(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
}

/// [low, high], or null where they are not finite.
[[nodiscard]] inline nlohmann::json interval_or_null(const RmsEstimate& estimate) {
  return std::isfinite(estimate.low) && std::isfinite(estimate.high)
             ? nlohmann::json{estimate.low, estimate.high}
             : nlohmann::json();
}

}  // namespace servotwin
