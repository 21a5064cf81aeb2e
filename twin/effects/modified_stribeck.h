// Stribeck friction that is continuous through rest (paper 001 eq. 2, with tanh over the whole
// bracket: as printed, over the exponential term alone, the force would keep its jump at rest).
//
//   d = [coulomb + drop exp(-(|v| / v_s)^delta)] tanh(v / velocity_limit) + viscous v
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct ModifiedStribeck {
  static constexpr Identity kIdentity{.id = "modified_stribeck",
                                      .meaning = "Stribeck friction, continuous through rest",
                                      .acts = Acts::kForce,
                                      .source = "paper 001 eq. 2",
                                      .confused = "stribeck"};
  static constexpr std::array<Parameter, 3> kShapes{
      {{"stribeck_velocity", "m/s", 1e-4, 0.2, 5e-3, "v_s"},
       {"stribeck_exponent", "1", 0.5, 2.0, 1.0, "delta"},
       {"velocity_limit", "m/s", 2e-5, 2e-2, 1e-3, "1 / k_s"}}};
  static constexpr std::array<Parameter, 3> kCoefficients{
      {{"coulomb", "m/s^2", 0.0, 100.0, 0.2, "Coulomb friction per moved mass"},
       {"drop", "m/s^2", -100.0, 100.0, 0.0, "breakaway beyond Coulomb"},
       {"viscous", "1/s", 0.0, 1000.0, 0.0, "viscous friction, beyond the poles", false}}};
  template <class T>
  using Memory = NoMemory;

  template <class T>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const Motion& m,
                          T* force) noexcept {
    using std::exp;
    using std::pow;
    using std::tanh;
    const double speed = std::abs(m.velocity);
    const T direction = tanh(m.velocity / shape[2]);
    force[0] = direction;
    force[1] = speed > 0.0 ? direction * exp(-pow(speed / shape[0], shape[1])) : T(0.0);
    force[2] = T(m.velocity);
  }
};

}  // namespace servotwin
