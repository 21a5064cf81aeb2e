// Maxwell-slip elements: what presliding friction remembers (generalised Maxwell slip, Al-Bender,
// Lampaert and Swevers 2005; thesis eq. 4.1, 4.2; docs/theory.md 3.5).
//
// An element is a spring that slides at its level. Over one cycle of displacement dx it sticks,
// breaks away within the cycle, or slides; sliding it relaxes to its level, and it sticks again
// when the motion turns. The step is exact in displacement, so that it is stable for any step and
// stiffness: |F| never grows beyond the level.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace servotwin {

/// Of one unit of breakaway force: stiffness [1/m | 1/rad] and level [1], the levels' sum is 1.
template <class T, std::size_t N>
struct MaxwellElements {
  std::array<T, N> stiffness, level;
};

/// The force after `dx` of an element of constant level: the spring's, clamped to the level.
template <class T>
T slip(const T& force, const T& stiffness, const T& level, double dx) noexcept {
  const T pulled = force + stiffness * dx;
  if (pulled > level) return level;
  if (pulled < -level) return -level;
  return pulled;
}

/// An element whose level changes with velocity, and which is drawn to it at a finite rate.
template <class T>
struct AttractedElement {
  /// An element at rest is not drawn to its level; below this travel per cycle [m | rad] it is
  /// drawn less, so that the force is continuous in the motion.
  static constexpr double kCreep = 1e-10;

  T force{0.0};
  int sliding = 0;  ///< +1, -1: direction it slides in; 0: it sticks

  /// Over one cycle of `dx` during `step_s`, with the level of this velocity; `rate` [1/s]: how
  /// fast a sliding element approaches its level.
  void advance(const T& stiffness, const T& level, const T& rate, double dx,
               double step_s) noexcept {
    using std::exp;
    if (dx == 0.0) return;
    const int direction = dx > 0.0 ? 1 : -1;
    const double sign = direction;
    if (sliding != direction) sliding = 0;
    if (sliding == 0) {
      const T pulled = force + stiffness * dx;
      if (sign * pulled < level) {
        force = pulled;
        return;
      }
      // It breaks away within the cycle and is at its level then, or it had been above it already.
      sliding = direction;
      if (sign * force < level) {
        force = sign * level;
        return;
      }
    }
    const double moving = std::abs(dx) / (std::abs(dx) + kCreep);
    force = sign * level + (force - sign * level) * exp(-rate * (moving * step_s));
  }
};

}  // namespace servotwin
