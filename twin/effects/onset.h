// Of effects that set in at a moment: 0 before it, 1 from 50 ms after it on.
#pragma once

namespace servotwin {

/// The ramp in between makes the moment a parameter that a search can follow.
inline constexpr double kOnset_s = 0.05;

template <class T>
[[nodiscard]] T onset(double time, const T& at) noexcept {
  const T share = (time - at) / kOnset_s;
  return share < 0.0 ? T(0.0) : (share > 1.0 ? T(1.0) : share);
}

}  // namespace servotwin
