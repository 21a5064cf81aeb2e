// Radians per turn: between a frequency [Hz] and an angular frequency [rad/s].
#pragma once

#include <numbers>

namespace servotwin {

inline constexpr double kTwoPi = 2.0 * std::numbers::pi;

}  // namespace servotwin
