// Presliding hysteresis: the reduced-parameter GMS of the thesis (4.3) with constant level (5.2).
//
//   d = breakaway * sum_i F_i,   F_i = clip(F_i + k_i dx, -alpha_i, alpha_i)
//
// k_i and alpha_i are the elements of the virgin curve (twin/virgin_curve.h) with this breakaway
// displacement and shape factor. The memory is non-local: inner loops close and return to the outer
// one. Viscous friction is part of the poles. Source: docs/theory.md 3.5 and 3.6.
#pragma once

#include <array>

#include "twin/effect.h"
#include "twin/virgin_curve.h"

namespace servotwin {

struct Presliding {
  static constexpr std::size_t kElements = 10;
  static constexpr Identity kIdentity{
      .id = "presliding",
      .meaning = "presliding hysteresis: friction that depends on the travel since reversal",
      .acts = Acts::kForce,
      .cause = "presliding",
      .replaces = "coulomb_friction",
      .check =
          "lubrication and preload of guides, screw or gear; friction compensation at reversals"};
  static constexpr std::array<Parameter, 2> kShapes{
      {{"breakaway_displacement", "m", 2e-7, 2e-3, 2e-5,
        "travel from rest after which the axis slides"},
       {"shape_factor", "1", 0.02, kMaxShape, 0.5,
        "0: force rises linearly with travel; towards 1: immediately"}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"breakaway", "m/s^2", 0.0, kMaxForce, 0.2, "breakaway force per moved mass"}, kViscous}};

  template <class T>
  struct Memory {
    explicit Memory(const T* shape) noexcept
        : elements(reduced_elements<kElements>(shape[0], shape[1])) {
      force.fill(T(0.0));
    }
    MaxwellElements<T, kElements> elements;
    std::array<T, kElements> force;
    template <class F>
    void each(const F& f) {
      for (T& one : force) f(one);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* /*shape*/, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    T sum(0.0);
    for (std::size_t i = 0; i < kElements; ++i) {
      memory.force[i] = slip(memory.force[i], memory.elements.stiffness[i],
                             memory.elements.level[i], m.displacement);
      sum += memory.force[i];
    }
    force[0] = sum;
    force[1] = T(m.velocity);
  }
};

}  // namespace servotwin
