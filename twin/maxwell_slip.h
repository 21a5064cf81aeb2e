// Maxwell-slip elements: the memory of presliding friction (generalised Maxwell slip; Al-Bender,
// Lampaert and Swevers 2005; thesis eq. 4.1 and 4.2; docs/theory.md 3.5).
//
//   F <- clip(F + k dx, -level, level)
//
// An element is a spring that slides at its level. Over one cycle of displacement dx it sticks,
// breaks away within the cycle, or slides; sliding it relaxes to its level, and it sticks again
// when the motion reverses. The step is exact in displacement and therefore stable for any step and
// stiffness: |F| never grows beyond the level.
//
// Any thread; allocates nothing, throws nothing.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>

namespace servotwin {

/// Elements per unit of breakaway force: stiffness [1/m | 1/rad] and level [1]; the levels sum
/// to 1.
template <class T, std::size_t N>
struct MaxwellElements {
  std::array<T, N> stiffness, level;
};

/// Force of an element of constant level after `dx`: that of the spring, clamped to the level.
template <class T, class D>
T slip(const T& force, const T& stiffness, const T& level, const D& dx) noexcept {
  T pulled = force + stiffness * dx;
  if (pulled > level) return level;
  if (pulled < -level) return -level;
  return pulled;
}

/// An element whose level changes with velocity and is approached at a finite rate.
template <class T>
struct AttractedElement {
  /// An element at rest does not approach its level. Below about this travel per cycle [m | rad] it
  /// does so more slowly, which keeps the force continuous in the motion.
  static constexpr double kCreep = 1e-10;

  T force{0.0};
  int sliding = 0;  ///< +1, -1: direction of sliding; 0: it sticks

  /// One cycle of displacement `dx` [m | rad] in `step_s` [s], with the level at this velocity. A
  /// sliding element approaches its level at `rate` [1/s].
  template <class D>
  void advance(const T& stiffness, const T& level, const T& rate, const D& dx,
               double step_s) noexcept {
    using std::abs;
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
      // It breaks away within the cycle and ends at its level, or it was above its level already.
      sliding = direction;
      if (sign * force < level) {
        force = sign * level;
        return;
      }
    }
    const D moving = abs(dx) / (abs(dx) + kCreep);
    force = sign * level + (force - sign * level) * exp(-rate * (moving * step_s));
  }
};

}  // namespace servotwin
