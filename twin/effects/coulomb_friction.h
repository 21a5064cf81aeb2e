// Friction of the rigid-body model: Coulomb friction with a saturated sign, and viscous friction
// (thesis eq. 3.12; docs/theory.md 3.1).
//
//   d = coulomb * sat(v / velocity_limit) + viscous * v,   sat(q) = min(1, max(-1, q))
//
// In closed loop a viscous force moves the poles (a1 contains B/J), so `viscous` is identifiable
// only if the loop is held fixed; with free poles it stays 0.
#pragma once

#include <array>

#include "twin/effect.h"
#include "twin/effects/saturated.h"

namespace servotwin {

struct CoulombFriction {
  static constexpr Identity kIdentity{
      .id = "coulomb_friction",
      .meaning = "Coulomb friction with a saturated sign, and viscous friction",
      .acts = Acts::kForce};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"velocity_limit", "m/s", 2e-5, 2e-2, 1e-3,
        "velocity at which the friction force is fully developed"}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"coulomb", "m/s^2", 0.0, kMaxForce, 0.2, "Coulomb friction per moved mass"}, kViscous}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    force[0] = saturated(m.velocity, shape[0]);
    force[1] = T(m.velocity);
  }
};

}  // namespace servotwin
