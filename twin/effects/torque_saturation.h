// A motor that cannot provide what the control demands.
//
//   asked = demand - held + viscous x',   d = share (asked - limit + held)  above the limit,
//   likewise below its negative, and share held between them
//   held' = a3 e - c2 x_r' + reset a1 e'   while that leads further beyond the limit
//
// The demand is that of the loop, including friction and the tracking error, so the limit stays
// active until the error has been corrected. A control holds its integrator meanwhile
// (anti-windup); the linear loop does not. `held` is what its integrator has added; reset = 1/Ti of
// a PI velocity control. Source: docs/theory.md 3.11.
#pragma once

#include <array>

#include "twin/effect.h"

namespace servotwin {

struct TorqueSaturation {
  static constexpr Identity kIdentity{
      .id = "torque_saturation",
      .meaning = "the control demands more torque than the motor can give",
      .acts = Acts::kForce,
      .cause = "torque_saturation",
      .check = "acceleration limits of the program against the torque limit of the motor",
      .on_motor = true};
  static constexpr std::array<Parameter, 3> kShapes{
      {{"limit_mps2", "m/s^2", 0.01, 1000.0, 1.0, "acceleration that the motor can give", true,
        false, Scan::kDemand},
       {"reset", "1/s", 0.1, 1000.0, 60.0, "reset rate of the velocity control's integrator, 1/Ti"},
       {"viscous", "1/s", 1e-3, 100.0, 0.3,
        "viscous friction that is part of the poles and that the motor overcomes as well"}}};
  static constexpr std::array<Parameter, 1> kCoefficients{
      {{"share", "1", -10.0, 10.0, 0.0, "share of the demand above the limit that is missing"}}};
  template <class T>
  struct Memory {
    explicit Memory(const T* /*shape*/) {}
    T held = T(0.0);
    template <class F>
    void each(const F& f) {
      f(held);
    }
  };

  template <class T, class M>
  static void unit_forces(const T* shape, Memory<T>& memory, const MotionOf<M>& m,
                          T* force) noexcept {
    const T asked = m.demand - memory.held + shape[2] * m.velocity;
    const T missing = asked > shape[0]    ? asked - shape[0]
                      : asked < -shape[0] ? asked + shape[0]
                                          : T(0.0);
    force[0] = missing + memory.held;
    const T rate = m.demand_rate + shape[1] * m.demand_damping;
    if (rate * missing > T(0.0)) memory.held += m.step_s * rate;
  }
};

}  // namespace servotwin
