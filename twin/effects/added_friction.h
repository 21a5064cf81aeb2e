// Friction that sets in at a moment: a cover that grips, a guide that runs dry.
//
//   d = onset(t - time) (coulomb direction(travel) + viscous v)
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"
#include "twin/effects/onset.h"
#include "twin/effects/sliding.h"

namespace servotwin {

struct AddedFriction {
  static constexpr Identity kIdentity{
      .id = "added_friction",
      .meaning = "friction that sets in at a moment of the recording",
      .acts = Acts::kForce,
      .source = "docs/theory.md 3.11",
      .confused =
          "inertia_change, whose force goes with acceleration; viscous_drift, which is gradual",
      .cause = "added_friction",
      .check = "what changed at that moment: cover, wiper, clamp, lubrication"};
  static constexpr std::array<Parameter, 2> kShapes{
      {{"time_s", "s", 1e-3, 1e7, 1.0, "when it sets in, in the recording", true, false,
        Scan::kTime},
       {"breakaway_displacement", "m", 2e-7, 2e-3, 1e-5,
        "travel over which it turns with the direction"}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"coulomb", "m/s^2", -100.0, 100.0, 0.0, "of what is added, per moved mass"},
       {"viscous", "1/s", -1000.0, 1000.0, 0.0, "of what is added, per moved mass"}}};
  template <class T>
  struct Memory : Sliding<T> {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
  };

  template <class T>
  static void unit_forces(const T* shape, Memory<T>& memory, const Motion& m, T* force) noexcept {
    const T direction = memory.direction(m.displacement, shape[1]);
    const T on = onset(m.time_s, shape[0]);
    force[0] = on * direction;
    force[1] = on * m.velocity;
  }
};

}  // namespace servotwin
