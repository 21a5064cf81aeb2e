// Checks of parameters: std::invalid_argument with field, value and rule.
#pragma once

#include <cmath>
#include <stdexcept>
#include <string>

namespace servotwin::virtual_machine {

inline void require_positive(double value, const std::string& field) {
  if (!(value > 0.0) || !std::isfinite(value)) {
    throw std::invalid_argument(field + " is " + std::to_string(value) +
                                ", must be positive and finite");
  }
}

inline void require_at_least_zero(double value, const std::string& field) {
  if (!(value >= 0.0) || !std::isfinite(value)) {
    throw std::invalid_argument(field + " is " + std::to_string(value) +
                                ", must be finite and at least 0");
  }
}

}  // namespace servotwin::virtual_machine
