// The part of friction that falls as speed rises, beside a friction that does not (Stribeck 1902).
//
//   d = drop sat(v / velocity_limit) exp(-(|v| / v_s)^delta)
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct FallingFriction {
  static constexpr Identity kIdentity{
      .id = "falling_friction",
      .meaning = "friction that is different at low speed: it falls, or rises, from breakaway",
      .acts = Acts::kForce,
      .source = "Stribeck 1902; Armstrong-Helouvry 1991",
      .confused = "presliding, which depends on travel and not on speed",
      .cause = "stribeck",
      .check = "lubrication of the guides; slow motion"};
  static constexpr std::array<Parameter, 3> kShapes{
      {{"stribeck_velocity", "m/s", 1e-4, 0.2, 1e-2, "v_s"},
       {"stribeck_exponent", "1", 0.5, 2.0, 1.0, "delta"},
       {"velocity_limit", "m/s", 2e-5, 2e-2, 1e-3,
        "velocity at which the force has its direction"}}};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"drop", "m/s^2", -100.0, 100.0, 0.0, "breakaway beyond Coulomb force, per moved mass"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const Motion& m,
                          T* force) noexcept {
    using std::exp;
    using std::pow;
    const double speed = std::abs(m.velocity);
    const T ramp = speed / shape[2];
    const T level = ramp > 1.0 ? T(1.0) : ramp;
    force[0] = T(0.0);
    if (speed == 0.0) return;
    force[0] = level * exp(-pow(speed / shape[0], shape[1]));
    if (m.velocity < 0.0) force[0] = -force[0];
  }
};

}  // namespace servotwin
