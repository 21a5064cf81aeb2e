// Generalised Maxwell slip with elements of free level (Al-Bender, Lampaert and Swevers 2005;
// thesis eq. 4.1 and 4.2; docs/theory.md 3.5).
//
//   d = sum_i level_i f_i,   sticking: df_i = dx / x_i
//                            sliding:  f_i -> s(v) at the rate attraction / s(v)
//   s(v) = 1 + (ratio - 1) exp(-(|v| / v_s)^2)
//
// The displacements x_i at which the elements slide are spaced evenly in the logarithm from `first`
// to `last`. The levels are separate coefficients, so any concave virgin curve is found by one
// linear fit.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"
#include "twin/maxwell_slip.h"

namespace servotwin {

struct Gms {
  static constexpr std::size_t kElements = 8;
  static constexpr Identity kIdentity{
      .id = "gms",
      .meaning = "generalised Maxwell slip with elements of free level and Stribeck curve",
      .acts = Acts::kForce};
  static constexpr std::array<Parameter, 5> kShapes{
      {{"first_displacement", "m", 1e-8, 1e-3, 5e-7, "travel after which the first element slides"},
       {"last_displacement", "m", 1e-7, 5e-3, 5e-5, "travel after which the last element slides"},
       {"breakaway_ratio", "1", 0.2, 5.0, 1.0, "breakaway over Coulomb force"},
       {"stribeck_velocity", "m/s", 1e-4, 0.2, 5e-3,
        "velocity scale of the transition between the two"},
       {"attraction", "1/s", 0.1, 1e5, 100.0,
        "C over Coulomb force: rate at which a sliding element approaches its level"}}};
  static constexpr std::array<Parameter, kElements + 1> kCoefficients{
      {{"level_1", "m/s^2", 0.0, kMaxForce, 0.02, "Coulomb level of the element per moved mass"},
       {"level_2", "m/s^2", 0.0, kMaxForce, 0.02, "Coulomb level of the element per moved mass"},
       {"level_3", "m/s^2", 0.0, kMaxForce, 0.02, "Coulomb level of the element per moved mass"},
       {"level_4", "m/s^2", 0.0, kMaxForce, 0.02, "Coulomb level of the element per moved mass"},
       {"level_5", "m/s^2", 0.0, kMaxForce, 0.02, "Coulomb level of the element per moved mass"},
       {"level_6", "m/s^2", 0.0, kMaxForce, 0.02, "Coulomb level of the element per moved mass"},
       {"level_7", "m/s^2", 0.0, kMaxForce, 0.02, "Coulomb level of the element per moved mass"},
       {"level_8", "m/s^2", 0.0, kMaxForce, 0.02, "Coulomb level of the element per moved mass"},
       kViscous}};

  template <class T>
  struct Memory {
    explicit Memory(const T* shape) noexcept {
      using std::exp;
      using std::log;
      for (std::size_t i = 0; i < kElements; ++i) {
        const double share = static_cast<double>(i) / static_cast<double>(kElements - 1);
        stiffness[i] = exp(-(log(shape[0]) + share * (log(shape[1]) - log(shape[0]))));
      }
    }
    std::array<T, kElements> stiffness;
    std::array<AttractedElement<T>, kElements> element{};
    template <class F>
    void each(const F& f) {
      for (auto& one : element) f(one.force);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::exp;
    const T q = m.velocity / shape[3];
    const T level = 1.0 + (shape[2] - 1.0) * exp(-q * q);
    for (std::size_t i = 0; i < kElements; ++i) {
      memory.element[i].advance(memory.stiffness[i], level, shape[4] / level, m.displacement,
                                m.step_s);
      force[i] = memory.element[i].force;
    }
    force[kElements] = T(m.velocity);
  }
};

}  // namespace servotwin
