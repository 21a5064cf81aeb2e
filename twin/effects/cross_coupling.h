// A force by the acceleration of another axis.
//
//   q'' + 2 zeta w q' + w^2 q = w^2 u,   u = x_r'' of the other axis
//   d = ratio q + lead q' / w + direct (u - q)
//
// Of the other axis only the command is known, but its motion, which lags, is what acts. Its loop
// is modelled by two poles, with the contributions of its velocity feed-forward (lead) and
// acceleration feed-forward (direct). Stepped exactly with the command's acceleration held over the
// cycle. Source: docs/theory.md 3.11.
#pragma once

#include <array>

#include "twin/effect.h"
#include "twin/effects/swing.h"

namespace servotwin {

struct CrossCoupling {
  static constexpr Identity kIdentity{
      .id = "cross_coupling",
      .meaning = "force caused by the acceleration of another axis",
      .acts = Acts::kForce,
      .cause = "cross_coupling",
      .check = "mounting and stiffness between the two axes; feed-forward of the other axis"};
  static constexpr std::array<Parameter, 2> kShapes{
      {{"other_frequency_hz", "Hz", 1.0, 1000.0, 20.0,
        "undamped frequency of the other axis' loop"},
       {"other_damping", "1", 0.3, 5.0, 0.9, "zeta of the other axis' loop"}}};
  static constexpr std::array<Parameter, 3> kCoefficients{
      {{"ratio", "1", -10.0, 10.0, 0.0, "acceleration of this axis per acceleration of the other"},
       {"lead", "1", -1000.0, 1000.0, 0.0, "contribution of the other axis' velocity feed-forward"},
       {"direct", "1", -100.0, 100.0, 0.0, "contribution of its acceleration feed-forward"}}};
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    Swing<T> other;  // [m/s^2], [m/s^3]
    template <class F>
    void each(const F& f) {
      other.each(f);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    const SwingStep<T> loop(shape[0], shape[1], m.step_s);
    loop.advance(memory.other, T(m.neighbour_acceleration));
    force[0] = memory.other.q;
    force[1] = memory.other.rate / loop.w;
    force[2] = m.neighbour_acceleration - memory.other.q;
  }
};

}  // namespace servotwin
