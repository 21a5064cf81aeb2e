// The onset of effects that set in at a moment: 0 before it, then a ramp to 1 within 50 ms.
//
// Any thread; allocates nothing, throws nothing.
#pragma once

namespace servotwin {

/// Duration of the ramp [s]. It makes the derivative by the moment nonzero, for a search.
inline constexpr double kOnset_s = 0.05;

template <class T>
[[nodiscard]] T onset(double time, const T& at) noexcept {
  const T share = (time - at) / kOnset_s;
  return share < 0.0 ? T(0.0) : (share > 1.0 ? T(1.0) : share);
}

}  // namespace servotwin
