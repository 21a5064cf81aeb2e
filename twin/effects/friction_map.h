// A small neural network for friction over velocity: one hidden layer of four units, linear output
// (Giberti et al. 2019, eq. 3; docs/theory.md 3.8).
//
//   d = sum_j output_j tanh(weight_j v / velocity_unit + bias_j) + output_0
//
// velocity_unit is 1 m/s. Four units can represent both directions of a Stribeck curve; more would
// fit the noise.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct FrictionMap {
  static constexpr std::size_t kUnits = 4;
  static constexpr Identity kIdentity{.id = "friction_map",
                                      .meaning = "friction over velocity as a small neural network",
                                      .acts = Acts::kForce};
  static constexpr std::array<Parameter, 2 * kUnits> kShapes{
      {{"weight_1", "s/m", 1.0, 1e5, 2000.0, "steep part around rest"},
       {"weight_2", "s/m", 0.1, 1e5, 200.0, "fall from breakaway"},
       {"weight_3", "s/m", 0.1, 1e5, 200.0, "fall from breakaway"},
       {"weight_4", "s/m", 0.1, 1e5, 5.0, "viscous part"},
       {"bias_1", "1", -20.0, 20.0, 0.0, ""},
       {"bias_2", "1", -20.0, 20.0, 1.0, ""},
       {"bias_3", "1", -20.0, 20.0, -1.0, ""},
       {"bias_4", "1", -20.0, 20.0, 0.0, ""}}};
  static constexpr std::array<Parameter, kUnits + 1> kCoefficients{
      {{"output_1", "m/s^2", -1e3, 1e3, 0.2, "output weight of unit 1"},
       {"output_2", "m/s^2", -1e3, 1e3, 0.0, "output weight of unit 2"},
       {"output_3", "m/s^2", -1e3, 1e3, 0.0, "output weight of unit 3"},
       {"output_4", "m/s^2", -1e3, 1e3, 0.0, "output weight of unit 4"},
       {"output_0", "m/s^2", -1e3, 1e3, 0.0, "constant"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::tanh;
    for (std::size_t j = 0; j < kUnits; ++j)
      force[j] = tanh(shape[j] * m.velocity + shape[kUnits + j]);
    force[kUnits] = T(1.0);
  }
};

}  // namespace servotwin
