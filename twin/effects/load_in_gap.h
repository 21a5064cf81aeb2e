// A load behind a gap. Where it needs neither push nor hold it crosses the gap by itself,
// decelerated by its friction alone, and the motor moves without it; at the other side it is taken
// along at once.
//
//   u' = - deceleration sat(u / velocity_limit)     u: velocity of the load in the gap
//   p' = v - u,   |p| <= width / 2                  at the limits u becomes v
//
// Used by backlash and backlash_behind_encoder. Source: docs/theory.md 3.11.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

inline constexpr std::array<Parameter, 3> kGapShapes{
    {{"width", "m", 1e-7, 1e-2, 1e-5, "width of the gap"},
     {"velocity_limit", "m/s", 2e-5, 2e-2, 1e-3,
      "velocity at which the friction force is fully developed"},
     {"deceleration", "m/s^2", 1e-2, 50.0, 0.5, "deceleration of the load by its friction alone"}}};

template <class T>
struct LoadInGap {
  LoadInGap() = default;
  explicit LoadInGap(const T* /*shape*/) noexcept {}
  T play = T(0.0);   // p
  T load = T(0.0);   // u
  T alone = T(0.0);  // v - u
  bool under_way = false;
  template <class F>
  void each(const F& f) {
    f(play);
    f(load);
    f(alone);
  }

  /// `shape`: those of kGapShapes.
  template <class M>
  void follow(const T* shape, const MotionOf<M>& m) noexcept {
    using std::abs;
    if (!under_way) load = T(m.velocity);  // starts with the motor
    under_way = true;
    const T half = 0.5 * shape[0], slows = m.step_s * shape[2];
    // Implicit, because friction is stiff near rest.
    T slower = load / (1.0 + slows / shape[1]);
    if (slower > shape[1]) slower = load - slows;
    if (slower < -shape[1]) slower = load + slows;
    T apart_rate = m.velocity - slower;
    const T apart = m.displacement - 0.5 * m.step_s * (load + slower);
    play += apart;
    const T beyond = abs(play) - half;
    if (beyond > 0.0) {
      // It reaches the side within the cycle and moves with it for the rest of the cycle.
      const T left = 1.0 - beyond / (abs(apart) + 1e-15);
      apart_rate = left > 0.0 ? T(apart_rate * left) : T(0.0);
      play = play > 0.0 ? half : T(-half);
    }
    alone = apart_rate;
    load = m.velocity - alone;
  }
};

}  // namespace servotwin
