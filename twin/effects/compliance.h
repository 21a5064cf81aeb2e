// A mass that swings on a spring, driven by the commanded acceleration and by the friction that it
// carries: table, column, screw.
//
//   q'' + 2 zeta w q' + w^2 q = - x_r'',     p'' + 2 zeta w p' + w^2 p = - (1 m/s^2) sat(v / v_0)
//   d = spring w q + damper q' + friction_spring w p + friction_damper p'
//
// By exact steps of the mode with what drives it held over the cycle; v_0 = 1 mm/s.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "twin/effect.h"

namespace servotwin {

struct Compliance {
  static constexpr Identity kIdentity{
      .id = "compliance",
      .meaning = "a mode of vibration that the motion excites",
      .acts = Acts::kForce,
      .source = "docs/theory.md 3.11",
      .confused = "periodic_disturbance, which goes on at rest; the loop's own pair of poles",
      .cause = "compliance",
      .check = "what swings at this frequency: table, column, foundation; filters of the control"};
  static constexpr std::array<Parameter, 2> kShapes{
      {{"frequency_hz", "Hz", 2.0, 2000.0, 50.0, "of the mode, undamped", true, false,
        Scan::kFrequency},
       {"damping_ratio", "1", 0.002, 0.2, 0.03, "zeta; more is no mode but a filter"}}};
  static constexpr std::array<Parameter, 4> kCoefficients{
      {{"spring", "1/s", -1e6, 1e6, 0.0, "force per deflection and angular frequency"},
       {"damper", "1/s", -1e6, 1e6, 0.0, "force per speed of deflection"},
       {"friction_spring", "1/s", -1e6, 1e6, 0.0, "the same of what friction deflects"},
       {"friction_damper", "1/s", -1e6, 1e6, 0.0, "the same of what friction deflects"}}};
  /// Deflection [m] and its rate [m/s].
  template <class T>
  struct Mode {
    T q = T(0.0), rate = T(0.0);

    /// One cycle under a constant acceleration; `c`, `s`: of the damped angle in it.
    void step(const T& w, const T& zeta, const T& damped, const T& fade, const T& c, const T& s,
              double acceleration) noexcept {
      // About the deflection at which it would rest.
      const T rest = -acceleration / (w * w), from = q - rest;
      const T along = (rate + zeta * w * from) / damped;
      q = rest + fade * (from * c + along * s);
      rate = fade * (rate * c - (w * from * w / damped + zeta * w * rate / damped) * s);
    }
  };
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    Mode<T> motion, friction;
  };

  template <class T>
  static void unit_forces(const T* shape, Memory<T>& memory, const Motion& m, T* force) noexcept {
    using std::cos;
    using std::exp;
    using std::sin;
    using std::sqrt;
    const T w = 2.0 * std::numbers::pi * shape[0], zeta = shape[1];
    const T damped = w * sqrt(1.0 - zeta * zeta), fade = exp(-zeta * w * m.step_s);
    const T s = sin(damped * m.step_s), c = cos(damped * m.step_s);
    constexpr double kDeveloped = 1e-3;  // velocity of the whole friction [m/s]
    const double direction = std::clamp(m.velocity / kDeveloped, -1.0, 1.0);
    memory.motion.step(w, zeta, damped, fade, c, s, m.command_acceleration);
    memory.friction.step(w, zeta, damped, fade, c, s, direction);
    force[0] = w * memory.motion.q;
    force[1] = memory.motion.rate;
    force[2] = w * memory.friction.q;
    force[3] = memory.friction.rate;
  }
};

}  // namespace servotwin
