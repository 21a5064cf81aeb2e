// Maxwell slip with elements of free displacement and level: any piecewise linear virgin curve, so
// that a friction of few elements can be followed exactly.
//
//   d = sum_i level_i f_i,   f_i = clip(f_i + dx / x_i, -1, 1),   x_1 < x_2 < ...
//
// The displacements are given by the first one and the ratio of each to the one before. The reduced
// form (presliding) has three parameters, this one twelve: it needs a motion with many reversals
// and a nearby start. Source: Al-Bender, Lampaert and Swevers 2005; docs/theory.md 3.5.
#pragma once

#include <array>

#include "twin/effect.h"
#include "twin/maxwell_slip.h"

namespace servotwin {

struct MaxwellSlip {
  static constexpr std::size_t kElements = 6;
  static constexpr Identity kIdentity{
      .id = "maxwell_slip",
      .meaning = "presliding hysteresis of elements with free displacement and level",
      .acts = Acts::kForce};
  static constexpr std::array<Parameter, kElements> kShapes{
      {{"first_displacement", "m", 1e-8, 1e-3, 1e-6, "travel after which the first element slides"},
       {"step_2", "1", 1.02, 50.0, 2.2, "travel of the second element over that of the first"},
       {"step_3", "1", 1.02, 50.0, 2.2, "travel of the third over that of the second"},
       {"step_4", "1", 1.02, 50.0, 2.2, "travel of the fourth over that of the third"},
       {"step_5", "1", 1.02, 50.0, 2.2, "travel of the fifth over that of the fourth"},
       {"step_6", "1", 1.02, 50.0, 2.2, "travel of the sixth over that of the fifth"}}};
  static constexpr std::array<Parameter, kElements + 1> kCoefficients{
      {{"level_1", "m/s^2", 0.0, kMaxForce, 0.03, "level of the element per moved mass"},
       {"level_2", "m/s^2", 0.0, kMaxForce, 0.03, "level of the element per moved mass"},
       {"level_3", "m/s^2", 0.0, kMaxForce, 0.03, "level of the element per moved mass"},
       {"level_4", "m/s^2", 0.0, kMaxForce, 0.03, "level of the element per moved mass"},
       {"level_5", "m/s^2", 0.0, kMaxForce, 0.03, "level of the element per moved mass"},
       {"level_6", "m/s^2", 0.0, kMaxForce, 0.03, "level of the element per moved mass"},
       kViscous}};

  template <class T>
  struct Memory {
    explicit Memory(const T* shape) noexcept {
      T displacement = shape[0];
      for (std::size_t i = 0; i < kElements; ++i) {
        if (i > 0) displacement *= shape[i];
        stiffness[i] = 1.0 / displacement;
      }
      force.fill(T(0.0));
    }
    std::array<T, kElements> stiffness, force;
    template <class F>
    void each(const F& f) {
      for (T& one : force) f(one);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* /*shape*/, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    for (std::size_t i = 0; i < kElements; ++i) {
      memory.force[i] = slip(memory.force[i], memory.stiffness[i], T(1.0), m.displacement);
      force[i] = memory.force[i];
    }
    force[kElements] = T(m.velocity);
  }
};

}  // namespace servotwin
