// Presliding hysteresis whose level falls with speed: the reduced-parameter GMS with a Stribeck
// curve (thesis 4.3 and eq. 4.2; docs/theory.md 3.5).
//
//   s(v) = 1 + (ratio - 1) exp(-(v / v_s)^2)      level over the Coulomb force; ratio at rest
//   F    = coulomb sum_i F_i:  F_i sticks with stiffness ratio k_i, slides when |F_i| reaches
//          alpha_i s(v), and then approaches it at the rate attraction / s(v)
//
// k_i and alpha_i are those of the virgin curve (twin/virgin_curve.h). From rest the axis slides
// after the breakaway displacement, at ratio times the Coulomb force.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"
#include "twin/virgin_curve.h"

namespace servotwin {

struct PreslidingStribeck {
  static constexpr std::size_t kElements = 10;
  static constexpr Identity kIdentity{
      .id = "presliding_stribeck",
      .meaning = "presliding hysteresis with friction that falls from breakaway as speed rises",
      .acts = Acts::kForce};
  static constexpr std::array<Parameter, 5> kShapes{
      {{"breakaway_displacement", "m", 2e-7, 2e-3, 2e-5,
        "travel from rest after which the axis slides"},
       {"shape_factor", "1", 0.02, kMaxShape, 0.5,
        "0: force rises linearly with travel; towards 1: immediately"},
       {"breakaway_ratio", "1", 0.5, 5.0, 1.3, "breakaway over Coulomb force"},
       {"stribeck_velocity", "m/s", 1e-4, 0.2, 5e-3,
        "velocity scale of the transition between the two"},
       {"attraction", "1/s", 0.1, 1e5, 100.0,
        "C over Coulomb force: rate at which a sliding element approaches its level"}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"coulomb", "m/s^2", 0.0, kMaxForce, 0.2, "Coulomb friction per moved mass"}, kViscous}};

  template <class T>
  struct Memory {
    explicit Memory(const T* shape) noexcept
        : elements(reduced_elements<kElements>(shape[0], shape[1])) {
      for (T& stiffness : elements.stiffness) stiffness *= shape[2];
    }
    MaxwellElements<T, kElements> elements;
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
    const T rate = shape[4] / level;
    force[0] = T(0.0);
    for (std::size_t i = 0; i < kElements; ++i) {
      memory.element[i].advance(memory.elements.stiffness[i], memory.elements.level[i] * level,
                                rate, m.displacement, m.step_s);
      force[0] += memory.element[i].force;
    }
    force[1] = T(m.velocity);
  }
};

}  // namespace servotwin
