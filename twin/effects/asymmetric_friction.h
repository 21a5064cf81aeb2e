// Difference of friction between the two directions, beside a symmetric friction law.
//
//   d = coulomb_difference |direction| + viscous_difference |v|
//
// direction is that of the friction law (Motion::direction). With F = F_c sgn(v) + F_v v:
//   F_c+- = F_c +- coulomb_difference,   F_v+- = F_v +- viscous_difference
// A constant force acts at rest as well; the Coulomb difference acts only in motion. Source:
// asymmetric model of Janot, Gautier and Brunot 2019; docs/theory.md 3.9.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct AsymmetricFriction {
  static constexpr Identity kIdentity{
      .id = "asymmetric_friction",
      .meaning = "friction that differs between the two directions",
      .acts = Acts::kForce,
      .cause = "asymmetric_friction",
      .replaces = "gravity_offset",
      .check =
          "wipers and covers; a counterbalance; whether nut or gear runs harder in one direction"};
  static constexpr std::array<Parameter, 0> kShapes{};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"coulomb_difference", "m/s^2", -kMaxForce, kMaxForce, 0.0,
        "half the difference of Coulomb friction, v > 0 minus v < 0, per moved mass"},
       {"viscous_difference", "1/s", -1000.0, 1000.0, 0.0,
        "half the difference of viscous friction, v > 0 minus v < 0, per moved mass"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* /*shape*/, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::abs;
    force[0] = T(abs(m.direction()));
    force[1] = T(abs(m.velocity));
  }
};

}  // namespace servotwin
