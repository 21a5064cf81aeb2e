// Play between the encoder of the loop and the load. The load crosses the gap by itself where it
// can (twin/effects/load_in_gap.h).
//
//   d = - friction (sat(v / velocity_limit) - sat(u / velocity_limit)) - load_share (v - u)'
//
// u is the velocity of the load. The model's friction and inertia always include the load: d is the
// part that does not act on the motor while the load is in the gap, and the impact at the end of
// the gap. Source: docs/theory.md 3.11.
#pragma once

#include <array>

#include "twin/effects/load_in_gap.h"
#include "twin/effects/saturated.h"

namespace servotwin {

struct BacklashBehindEncoder {
  static constexpr Identity kIdentity{
      .id = "backlash_behind_encoder",
      .meaning = "play between the encoder of the loop and the load",
      .acts = Acts::kForce,
      .cause = "backlash",
      .check = "play of coupling, nut or gear, and bearings behind the encoder",
      .on_motor = true};
  static constexpr std::array<Parameter, 3> kShapes = kGapShapes;
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"friction", "m/s^2", 0.0, kMaxForce, 0.0, "friction of the load, per moved mass"},
       {"load_share", "1", 0.0, 1.0, 0.0, "share of the moved mass that is behind the gap"}}};
  template <class T>
  using Memory = LoadInGap<T>;

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    const T before = memory.alone;
    memory.follow(shape, m);
    force[0] = saturated(memory.load, shape[1]) - saturated(m.velocity, shape[1]);
    force[1] = -(memory.alone - before) / m.step_s;
  }
};

}  // namespace servotwin
