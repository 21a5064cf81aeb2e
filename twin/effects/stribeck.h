// Stribeck friction with separate directions (Giberti et al. 2019, section 3.1: nine parameters;
// docs/theory.md 3.8).
//
//   v > 0:  d =  coulomb_plus  + drop_plus  exp(-(|v| / v_s+)^delta) + viscous_plus v
//   v < 0:  d = -coulomb_minus - drop_minus exp(-(|v| / v_s-)^delta) + viscous_minus v
//
// drop = breakaway minus Coulomb force. On one axis a constant force cannot be separated from
// different levels: it is part of coulomb_plus and coulomb_minus. The jump at v = 0 is a ramp over
// +-velocity_limit, as in coulomb_friction, so that it can be simulated at rest.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct Stribeck {
  static constexpr Identity kIdentity{
      .id = "stribeck",
      .meaning = "friction that falls from breakaway to Coulomb as speed rises, per direction",
      .acts = Acts::kForce};
  static constexpr std::array<Parameter, 4> kShapes{
      {{"stribeck_velocity_plus", "m/s", 1e-4, 0.2, 5e-3, "Stribeck velocity v_s+"},
       {"stribeck_velocity_minus", "m/s", 1e-4, 0.2, 5e-3, "Stribeck velocity v_s-"},
       {"stribeck_exponent", "1", 0.5, 2.0, 1.0, "Stribeck exponent delta"},
       {"velocity_limit", "m/s", 2e-5, 2e-2, 1e-3,
        "velocity at which the friction force is fully developed"}}};
  static constexpr std::array<Parameter, 6> kCoefficients{
      {{"coulomb_plus", "m/s^2", 0.0, kMaxForce, 0.2, "Coulomb friction per moved mass, v > 0"},
       {"coulomb_minus", "m/s^2", 0.0, kMaxForce, 0.2, "Coulomb friction per moved mass, v < 0"},
       {"drop_plus", "m/s^2", -kMaxForce, kMaxForce, 0.0, "breakaway minus Coulomb force, v > 0"},
       {"drop_minus", "m/s^2", -kMaxForce, kMaxForce, 0.0, "breakaway minus Coulomb force, v < 0"},
       {"viscous_plus", "1/s", -1000.0, 1000.0, 0.0,
        "viscous friction in addition to the poles, v > 0", false, true},
       {"viscous_minus", "1/s", -1000.0, 1000.0, 0.0,
        "viscous friction in addition to the poles, v < 0; with free poles: its excess over v > 0",
        true, true}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::abs;
    using std::exp;
    using std::pow;
    const bool plus = m.velocity >= 0.0;
    const M speed = abs(m.velocity);
    const T ramp = speed / shape[3];
    const T level = ramp > 1.0 ? T(1.0) : ramp;
    const T& limit = shape[plus ? 0 : 1];
    const T drop = speed > 0.0 ? level * exp(-pow(speed / limit, shape[2])) : T(0.0);
    const std::size_t here = plus ? 0 : 1;
    for (std::size_t i = 0; i < 6; ++i) force[i] = T(0.0);
    force[here] = plus ? level : -level;
    force[2 + here] = plus ? drop : -drop;
    force[4 + here] = T(m.velocity);
  }
};

}  // namespace servotwin
