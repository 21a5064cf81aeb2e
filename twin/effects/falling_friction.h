// The part of friction that falls as speed rises, beside a friction law without it (Stribeck 1902;
// Armstrong-Helouvry 1991; docs/theory.md 3.10).
//
//   d = drop direction exp(-(|v| / v_s)^delta)
//
// direction is that of the friction law (Motion::direction).
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct FallingFriction {
  static constexpr Identity kIdentity{
      .id = "falling_friction",
      .meaning = "friction that falls (or rises) with speed from its breakaway value",
      .acts = Acts::kForce,
      .cause = "stribeck",
      .check = "lubrication of the guides; slow motion"};
  static constexpr std::array<Parameter, 2> kShapes{
      {{"stribeck_velocity", "m/s", 1e-4, 0.2, 1e-2, "Stribeck velocity v_s"},
       {"stribeck_exponent", "1", 0.5, 2.0, 1.0, "Stribeck exponent delta"}}};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"drop", "m/s^2", -kMaxForce, kMaxForce, 0.0,
        "breakaway minus Coulomb force, per moved mass"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::abs;
    using std::exp;
    using std::pow;
    const M speed = abs(m.velocity);
    force[0] = T(m.direction());
    if (speed > 0.0) force[0] *= exp(-pow(speed / shape[0], shape[1]));
  }
};

}  // namespace servotwin
