// An error of the encoder in the loop, periodic in position: eccentric disc, interpolation.
//
//   reading = x + epsilon(x),   epsilon = sine sin(2 pi x / period) + cosine cos(..)
//   d = - d2 epsilon / dt2
//
// In terms of the reading, the loop is disturbed only by the acceleration of epsilon. Source:
// docs/theory.md 3.11.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

#include "twin/effect.h"

namespace servotwin {

struct EncoderError {
  static constexpr Identity kIdentity{
      .id = "encoder_error",
      .meaning = "an error of the encoder in the loop, periodic in position",
      .acts = Acts::kForce,
      .cause = "encoder_error",
      .check = "mounting and cleanness of the encoder; eccentricity, signal amplitudes"};
  static constexpr std::array<Parameter, 1> kShapes{
      {{"period", "m", 2e-5, 10.0, 5e-3, "period of the error along the axis", true, false,
        Scan::kPeriod}}};
  static constexpr std::array<Parameter, 2> kCoefficients{
      {{"sine", "m", -1e-3, 1e-3, 0.0, "amplitude of the sine"},
       {"cosine", "m", -1e-3, 1e-3, 0.0, "amplitude of the cosine"}}};
  template <class T>
  using Memory = NoMemory;

  template <class T, class M>
  static void unit_forces(const T* shape, NoMemory& /*memory*/, const MotionOf<M>& m,
                          T* force) noexcept {
    using std::cos;
    using std::sin;
    const T k = 2.0 * std::numbers::pi / shape[0];
    const T s = sin(k * m.position), c = cos(k * m.position);
    const T turning = k * m.velocity * (k * m.velocity), speeding = k * m.command_acceleration;
    force[0] = turning * s - speeding * c;
    force[1] = turning * c + speeding * s;
  }
};

}  // namespace servotwin
