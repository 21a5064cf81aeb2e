// Stribeck friction that is continuous through rest, with separate directions (Giberti et al. 2019,
// section 3.1, with tanh over the whole bracket: as printed, over the exponential term alone, the
// force would still jump at rest; docs/theory.md 3.8).
//
//   v > 0:  d = [coulomb_plus  + drop_plus  exp(-(|v| / v_s+)^delta)] tanh(v / velocity_limit)
//               + viscous_plus v,   v < 0 likewise with the minus parameters
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"
#include "twin/effects/stribeck.h"

namespace servotwin {

struct ModifiedStribeck {
  static constexpr Identity kIdentity{
      .id = "modified_stribeck",
      .meaning = "Stribeck friction, continuous through rest, by direction",
      .acts = Acts::kForce};
  static constexpr std::array<Parameter, 4> kShapes{
      {Stribeck::kShapes[0],
       Stribeck::kShapes[1],
       Stribeck::kShapes[2],
       {"velocity_limit", "m/s", 2e-6, 2e-2, 1e-3, "1 / k_s"}}};
  static constexpr std::array<Parameter, 6> kCoefficients = Stribeck::kCoefficients;
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::abs;
    using std::exp;
    using std::pow;
    using std::tanh;
    const std::size_t here = m.velocity >= 0.0 ? 0 : 1;
    const M speed = abs(m.velocity);
    const T direction = tanh(m.velocity / shape[3]);
    for (std::size_t i = 0; i < 6; ++i) force[i] = T(0.0);
    force[here] = direction;
    force[2 + here] = speed > 0.0 ? direction * exp(-pow(speed / shape[here], shape[2])) : T(0.0);
    force[4 + here] = T(m.velocity);
  }
};

}  // namespace servotwin
