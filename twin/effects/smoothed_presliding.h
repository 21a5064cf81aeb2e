// The reduced-parameter GMS with elements that yield gradually (smoothed GMS: continuous transition
// from sticking to sliding, after Boegli, De Laet, De Schutter and Swevers 2014; docs/theory.md
// 3.5).
//
//   dF_i/dx = k_i (1 - sgn(dx) F_i / alpha_i),   exactly:
//   F_i -> g alpha_i + (F_i - g alpha_i) exp(-|dx| k_i / alpha_i),   g = sgn(dx)
//
// Each element is a Dahl spring, so the force is smooth in the motion and in the parameters. It
// reaches its level only asymptotically and closes inner loops only approximately.
#pragma once

#include <array>
#include <cmath>

#include "twin/effect.h"
#include "twin/virgin_curve.h"

namespace servotwin {

struct SmoothedPresliding {
  static constexpr std::size_t kElements = 10;
  static constexpr Identity kIdentity{
      .id = "smoothed_presliding",
      .meaning = "presliding hysteresis whose elements yield gradually",
      .acts = Acts::kForce};
  static constexpr std::array<Parameter, 2> kShapes{
      {{"breakaway_displacement", "m", 2e-7, 2e-3, 2e-5,
        "travel at which the last element of the curve would slide"},
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
    using std::abs;
    using std::exp;
    T sum(0.0);
    const double sign = m.displacement > 0.0 ? 1.0 : -1.0;
    for (std::size_t i = 0; i < kElements; ++i) {
      T& f = memory.force[i];
      if (m.displacement != 0.0) {
        const T level = sign * memory.elements.level[i];
        f = level + (f - level) * exp(-abs(m.displacement) * memory.elements.stiffness[i] /
                                      memory.elements.level[i]);
      }
      sum += f;
    }
    force[0] = sum;
    force[1] = T(m.velocity);
  }
};

}  // namespace servotwin
