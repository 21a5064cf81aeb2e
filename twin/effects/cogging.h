// A force that is periodic in position: cogging of a motor, pitch of a screw, passage of balls.
//
//   d = sine sin(2 pi x / period) + cosine cos(..) + the same at half the period
//
// Source: docs/theory.md 3.10.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "twin/effect.h"

namespace servotwin {

struct Cogging {
  static constexpr Identity kIdentity{
      .id = "cogging",
      .meaning = "a force periodic in position, and its second harmonic",
      .acts = Acts::kForce,
      .cause = "cogging",
      .check =
          "what repeats with this period: a turn of screw or gear, balls or teeth, the motor's "
          "poles",
      .on_motor = true};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"period", "m", 5e-5, 10.0, 5e-3, "period of the force along the axis", true, false,
        Scan::kPeriod}}};
  static constexpr std::array<Parameter, 4> kCoefficients{
      {{"sine", "m/s^2", -kMaxForce, kMaxForce, 0.0, "amplitude of the sine, per moved mass"},
       {"cosine", "m/s^2", -kMaxForce, kMaxForce, 0.0, "amplitude of the cosine"},
       {"sine_2", "m/s^2", -kMaxForce, kMaxForce, 0.0, "amplitude of the sine at half the period"},
       {"cosine_2", "m/s^2", -kMaxForce, kMaxForce, 0.0,
        "amplitude of the cosine at half the period"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::cos;
    using std::sin;
    const T angle = 2.0 * std::numbers::pi * m.position / shape[0];
    force[0] = sin(angle);
    force[1] = cos(angle);
    force[2] = sin(2.0 * angle);
    force[3] = cos(2.0 * angle);
  }
};

}  // namespace servotwin
