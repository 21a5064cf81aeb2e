// The moved mass of the virtual machine: a rigid body with friction under a force that is held.
//
//   x' = v,   m v' = u - B v - F - F0
//
// u: motor force, constant during `advance`; F: friction (friction.h); F0: a constant load the
// motor must hold. Runge-Kutta of fourth order, cut at every event of the friction model, whose
// time is bisected to 2^-40 of the step: stopping, sticking and yielding cost no accuracy.
//
// SI units. Errors: std::invalid_argument for parameters out of range; std::runtime_error if events
// do not come to an end. One thread per body.
#pragma once

#include "tests/virtual_machine/friction.h"

namespace servotwin::virtual_machine {

struct BodyParameters {
  double mass = 1.0;            ///< [kg], with the inertia of motor and screw
  double viscous = 0.0;         ///< B [N s/m]
  double constant_force = 0.0;  ///< F0 [N], positive: against positive motion
  Friction friction = NoFriction{};
};

struct BodyState {
  double position = 0.0;
  double velocity = 0.0;
  FrictionState friction;
};

class Body {
 public:
  explicit Body(const BodyParameters& parameters, double position = 0.0, double velocity = 0.0);

  /// Moves on by `h` seconds under the motor force `u`.
  void advance(double u, double h);

  [[nodiscard]] const BodyState& state() const { return state_; }
  /// The friction force. Only a body that sticks needs `u`, the motor force it then balances.
  [[nodiscard]] double friction_force(double u) const;

 private:
  [[nodiscard]] double applied(double u, double velocity) const {
    return u - parameters_.constant_force - parameters_.viscous * velocity;
  }
  [[nodiscard]] BodyState runge_kutta(double u, double h) const;
  [[nodiscard]] bool holds(double u, const BodyState& s) const {
    return mode_holds(parameters_.friction, s.velocity, applied(u, s.velocity), s.friction);
  }

  BodyParameters parameters_;
  int friction_states_ = 0;
  BodyState state_;
};

}  // namespace servotwin::virtual_machine
