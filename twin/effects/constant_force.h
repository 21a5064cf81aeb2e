// A constant force: gravity, an unbalanced counterweight, an amplifier offset.
//
//   d = offset
//
// Positive: the motor must hold a force in the positive direction. A loop with integral action
// compensates it at rest; command and encoder then show only its transient. Source: docs/theory.md
// 3.2.
#pragma once

#include <array>

#include "twin/effect.h"

namespace servotwin {

struct ConstantForce {
  static constexpr Identity kIdentity{.id = "gravity_offset",
                                      .meaning = "constant force that the motor must hold",
                                      .acts = Acts::kForce,
                                      .cause = "gravity_offset",
                                      .check =
                                          "whether it is the weight of the axis (no fault); else "
                                          "counterweight, brake, a cable that pulls"};
  static constexpr std::array<Parameter, 0> kShapes{};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"offset_mps2", "m/s^2", -kMaxForce, kMaxForce, 0.0, "constant force per moved mass"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* /*shape*/, NoMemory& /*memory*/, const MotionOf<M>& /*m*/,
                          T* force) noexcept {
    force[0] = T(1.0);
  }
};

}  // namespace servotwin
