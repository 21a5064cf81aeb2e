// A constant force: gravity, a counterbalance out of trim, an amplifier offset.
//
//   d = offset
//
// Positive: the force the motor must hold points in the positive direction. A loop with integral
// action rejects it at rest, and command and encoder alone show only its transient.
#pragma once

#include <array>

#include "twin/effect.h"

namespace servotwin {

struct ConstantForce {
  static constexpr Identity kIdentity{
      .id = "gravity_offset",
      .meaning = "constant force that the motor must hold",
      .acts = Acts::kForce,
      .source = "docs/theory.md 3.2",
      .confused =
          "asymmetric Coulomb friction (the same on one axis); invisible behind an integrator",
      .cause = "gravity_offset",
      .check = "counterweight or brake; a cable that pulls"};
  static constexpr std::array<Parameter, 0> kShapes{};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"offset_mps2", "m/s^2", -100.0, 100.0, 0.0, "constant force per moved mass"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T>
  static void unit_forces(const T* /*shape*/, NoMemory& /*memory*/, const Motion& /*m*/,
                          T* force) noexcept {
    force[0] = T(1.0);
  }
};

}  // namespace servotwin
