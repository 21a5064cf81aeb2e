// LuGre friction (Canudas de Wit et al. 1995; Ferkl et al. 2021, eq. 1 to 3, with |v| in the
// exponent; docs/theory.md 3.7).
//
//   dz/dt = v - |v| z / g(v),   g = deflection [1 + (ratio - 1) exp(-(|v| / v_s)^delta)]
//   d = coulomb (z + damping_time dz/dt) / deflection + viscous v
//
// that is, sigma0 = coulomb / deflection, sigma1 = sigma0 damping_time, F_s = ratio F_c. The
// bristle is stepped exactly in displacement with g at the cycle's velocity, so it is stable for
// any step and stiffness; an explicit step at 1 ms is not.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct LuGre {
  static constexpr Identity kIdentity{
      .id = "lugre",
      .meaning = "LuGre friction: bristle deflection with Stribeck curve and damping",
      .acts = Acts::kForce};
  static constexpr std::array<Parameter, 5> kShapes{
      {{"deflection", "m", 2e-8, 2e-3, 5e-6, "Coulomb force over bristle stiffness"},
       {"breakaway_ratio", "1", 0.2, 5.0, 1.0, "breakaway over Coulomb force"},
       {"stribeck_velocity", "m/s", 1e-4, 0.2, 5e-3,
        "velocity scale of the transition between the two"},
       {"stribeck_exponent", "1", 0.5, 2.0, 1.0, "Stribeck exponent delta"},
       {"damping_time", "s", 1e-6, 0.05, 1e-3, "bristle damping over bristle stiffness"}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"coulomb", "m/s^2", 0.0, kMaxForce, 0.2, "Coulomb friction per moved mass"}, kViscous}};

  template <class T>
  struct Memory {
    explicit Memory(const T* /*shape*/) noexcept {}
    T bristle{0.0};  ///< z over deflection
    template <class F>
    void each(const F& f) {
      f(bristle);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::abs;
    using std::exp;
    using std::pow;
    T level(1.0);
    const M speed = abs(m.velocity);
    if (speed > 0.0) {
      level += (shape[1] - 1.0) * exp(-pow(speed / shape[2], shape[3]));
    } else {
      level = shape[1];
    }
    const T before = memory.bristle;
    if (m.displacement != 0.0) {
      const T end = m.displacement > 0.0 ? level : -level;
      memory.bristle = end + (before - end) * exp(-abs(m.displacement) / (level * shape[0]));
    }
    force[0] = memory.bristle + shape[4] * (memory.bristle - before) / m.step_s;
    force[1] = T(m.velocity);
  }
};

}  // namespace servotwin
