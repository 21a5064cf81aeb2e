// A mass that swings on a spring, driven by the commanded acceleration: table, column, screw.
//
//   q'' + 2 zeta w q' + w^2 q = - x_r'',   d = spring w q + damper q'
//
// By exact steps of the mode with the acceleration held over the cycle.
#pragma once

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
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"spring", "1/s", -1e6, 1e6, 0.0, "force per deflection and angular frequency"},
       {"damper", "1/s", -1e6, 1e6, 0.0, "force per speed of deflection"}}};
  template <class T>
  struct Memory {
    Memory() = default;
    explicit Memory(const T* /*shape*/) noexcept {}
    T q = T(0.0), rate = T(0.0);  // deflection [m] and its rate [m/s]
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
    // About the deflection at which it would rest.
    const T rest = -m.command_acceleration / (w * w), q = memory.q - rest;
    const T along = (memory.rate + zeta * w * q) / damped;
    memory.q = rest + fade * (q * c + along * s);
    memory.rate =
        fade * (memory.rate * c - (w * q * w / damped + zeta * w * memory.rate / damped) * s);
    force[0] = w * memory.q;
    force[1] = memory.rate;
  }
};

}  // namespace servotwin
