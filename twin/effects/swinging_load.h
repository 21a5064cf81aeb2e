// Gravity of a load that swings with a rotary axis: a tilting table, a joint of a robot.
//
//   d = sine sin(x) + cosine cos(x),   x: the angle of the axis [rad]
//
// The weight times its arm over the moment of inertia; which of the two it is depends on where the
// zero of the axis is. Source: docs/theory.md 3.2.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct SwingingLoad {
  static constexpr Identity kIdentity{
      .id = "swinging_load",
      .meaning = "weight of a load that swings with the axis",
      .acts = Acts::kForce,
      .cause = "gravity_offset",
      .check = "whether it is the weight of the load (no fault); else counterweight, brake"};
  static constexpr std::array<Parameter, 0> kShapes{};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"sine", "m/s^2", -1000.0, 1000.0, 0.0, "force at a quarter of a turn, per moved mass"},
       {"cosine", "m/s^2", -1000.0, 1000.0, 0.0, "force at the zero of the axis"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* /*shape*/, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::cos;
    using std::sin;
    force[0] = T(sin(m.position));
    force[1] = T(cos(m.position));
  }
};

}  // namespace servotwin
