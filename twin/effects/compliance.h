// A mode of vibration (table, column, screw on a spring), excited by the commanded acceleration and
// by the change of friction at reversals.
//
//   q'' + 2 zeta w q' + w^2 q = - x_r''
//   r'' + 2 zeta w r' + w^2 r = - w^2 s,   s: direction of friction (Motion::direction)
//   d = spring w q + damper q' + ringing (r + s) + fading r' / w
//
// Stepped exactly with both inputs held over the cycle. All coefficients are free, because a loop
// that is disturbed by a mode moves its zeros. Source: docs/theory.md 3.11.
#pragma once

#include <array>

#include "twin/effect.h"
#include "twin/effects/swing.h"

namespace servotwin {

struct Compliance {
  static constexpr Identity kIdentity{
      .id = "compliance",
      .meaning = "a mode of vibration that the motion excites",
      .acts = Acts::kForce,
      .cause = "compliance",
      .check = "what vibrates at this frequency: table, column, foundation; filters of the control",
      .on_motor = true};
  static constexpr std::array<Parameter, 2> kShapes{
      {{"frequency_hz", "Hz", 2.0, 2000.0, 50.0, "undamped frequency of the mode", true, false,
        Scan::kFrequency},
       {"damping_ratio", "1", 0.002, 0.2, 0.03, "zeta; a higher value is a filter, not a mode"}}};
  static constexpr std::array<Parameter, 4> kCoefficients{
      {{"spring", "1/s", -1e6, 1e6, 0.0, "force per deflection and angular frequency"},
       {"damper", "1/s", -1e6, 1e6, 0.0, "force per speed of deflection"},
       {"ringing", "m/s^2", -kMaxForce, kMaxForce, 0.0,
        "force per deflection by friction, from its rest value"},
       {"fading", "m/s^2", -kMaxForce, kMaxForce, 0.0,
        "force per rate of that deflection over angular frequency"}}};
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    Swing<T> by_command;   // [m], [m/s]
    Swing<T> by_friction;  // r [1], [1/s]
    template <class F>
    void each(const F& f) {
      by_command.each(f);
      by_friction.each(f);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    const SwingStep<T> mode(shape[0], shape[1], m.step_s);
    const T direction(m.direction());
    mode.advance(memory.by_command, -m.command_acceleration / (mode.w * mode.w));
    mode.advance(memory.by_friction, -direction);
    force[0] = mode.w * memory.by_command.q;
    force[1] = memory.by_command.rate;
    force[2] = memory.by_friction.q + direction;
    force[3] = memory.by_friction.rate / mode.w;
  }
};

}  // namespace servotwin
