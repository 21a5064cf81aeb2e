// Feed-forward that differs from that of the identified loop.
//
//   d = - velocity_gain * dx_r/dt - acceleration_gain * d2x_r/dt2
//
// More feed-forward pushes with the command and is a negative disturbance. A free tracking
// numerator already contains both columns (order 3: s^2/P x_r and s^3/P x_r), so the effect is
// identifiable only if the loop is held fixed (an earlier model). Source: docs/theory.md 3.3.
#pragma once

#include <array>

#include "twin/effect.h"

namespace servotwin {

struct FeedforwardMismatch {
  static constexpr Identity kIdentity{
      .id = "feedforward_mismatch",
      .meaning = "velocity or acceleration feed-forward that differs from that of the loop",
      .acts = Acts::kForce,
      .on_motor = true,
      .of_control = true};
  static constexpr std::array<Parameter, 0> kShapes{};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"velocity_gain", "1/s", -2000.0, 2000.0, 0.0, "excess velocity feed-forward", false},
       {"acceleration_gain", "1", -10.0, 10.0, 0.0, "excess acceleration feed-forward", false}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* /*shape*/, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    force[0] = T(-m.command_velocity);
    force[1] = T(-m.command_acceleration);
  }
};

}  // namespace servotwin
