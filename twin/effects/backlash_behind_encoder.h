// Play between the encoder of the loop and the load. Where the load need not be pushed or held it
// crosses the gap by itself, slowed by its friction alone, and the motor moves without it; at the
// other side it is taken along at once.
//
//   u' = - deceleration sat(u / velocity_limit)     the load's velocity in the gap
//   p' = v - u,   |p| <= width / 2                  there u becomes v
//   d = - friction (sat(v / velocity_limit) - sat(u / velocity_limit)) - load_share (v - u)'
//
// The model's friction and inertia have the load at all times: d is what of them is not there in
// the gap, and the impact at its end (docs/theory.md 3.11).
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"
#include "twin/effects/saturated.h"

namespace servotwin {

struct BacklashBehindEncoder {
  static constexpr Identity kIdentity{
      .id = "backlash_behind_encoder",
      .meaning = "play between the encoder of the loop and the load",
      .acts = Acts::kForce,
      .source = "docs/theory.md 3.11",
      .confused = "presliding, which takes its force back with the way; compliance",
      .cause = "backlash",
      .check = "play of coupling, nut and bearings behind the encoder"};
  static constexpr std::array<Parameter, 3> kShapes{
      {{"width", "m", 1e-7, 1e-2, 1e-5, "of the gap"},
       {"velocity_limit", "m/s", 2e-5, 2e-2, 1e-3,
        "velocity at which the friction force is fully developed"},
       {"deceleration", "m/s^2", 1e-2, 50.0, 0.5, "of the load by its friction alone"}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"friction", "m/s^2", 0.0, 100.0, 0.0, "of the load, per moved mass"},
       {"load_share", "1", 0.0, 1.0, 0.0, "of the moved mass, behind the gap"}}};
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    T play = T(0.0);   // p
    T load = T(0.0);   // u
    T alone = T(0.0);  // v - u
    bool under_way = false;
  };

  template <class T>
  static void unit_forces(const T* shape, Memory<T>& memory, const Motion& m, T* force) noexcept {
    using std::abs;
    if (!memory.under_way) memory.load = T(m.velocity);  // at first it goes with the motor
    memory.under_way = true;
    const T half = 0.5 * shape[0], slows = m.step_s * shape[2], before = memory.alone;
    // Implicit, since friction is stiff about rest.
    T load = memory.load / (1.0 + slows / shape[1]);
    if (load > shape[1]) load = memory.load - slows;
    if (load < -shape[1]) load = memory.load + slows;
    T alone = m.velocity - load;
    const T apart = m.displacement - 0.5 * m.step_s * (memory.load + load);
    memory.play += apart;
    const T beyond = abs(memory.play) - half;
    if (beyond > 0.0) {
      // At the side it meets the load with what is left of the cycle.
      const T left = 1.0 - beyond / (abs(apart) + 1e-15);
      alone = left > 0.0 ? T(alone * left) : T(0.0);
      memory.play = memory.play > 0.0 ? half : T(-half);
    }
    memory.alone = alone;
    memory.load = m.velocity - alone;
    force[0] = saturated(memory.load, shape[1]) - saturated(m.velocity, shape[1]);
    force[1] = -(alone - before) / m.step_s;
  }
};

}  // namespace servotwin
