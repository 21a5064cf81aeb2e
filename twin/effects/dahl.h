// Dahl friction (Dahl 1968; docs/theory.md 3.7), exact in displacement.
//
//   dF/dx = (F_c / x_d) (1 - sgn(dx) F / F_c):   F -> g F_c + (F - g F_c) exp(-|dx| / x_d)
//
// g = sgn(dx). Hysteresis without non-local memory: a small loop does not close.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"

namespace servotwin {

struct Dahl {
  static constexpr Identity kIdentity{.id = "dahl",
                                      .meaning = "Dahl friction: one spring that yields gradually",
                                      .acts = Acts::kForce};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"deflection", "m", 2e-8, 2e-3, 5e-6, "Coulomb force over initial stiffness"}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"coulomb", "m/s^2", 0.0, kMaxForce, 0.2, "Coulomb friction per moved mass"}, kViscous}};

  template <class T>
  struct Memory {
    explicit Memory(const T* /*shape*/) noexcept {}
    T force{0.0};
    template <class F>
    void each(const F& f) {
      f(force);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::abs;
    using std::exp;
    if (m.displacement != 0.0) {
      const double level = m.displacement > 0.0 ? 1.0 : -1.0;
      memory.force = level + (memory.force - level) * exp(-abs(m.displacement) / shape[0]);
    }
    force[0] = memory.force;
    force[1] = T(m.velocity);
  }
};

}  // namespace servotwin
