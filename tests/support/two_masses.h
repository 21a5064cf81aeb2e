// An axis of two masses on a spring (tests/hidden_effects/rig.h) and the poles it really has.
//
// A table of 30 kg at 45 Hz and 3 % of damping in front of a motor of 70 kg, its encoder in the
// position loop, friction on the table; encoder of 0.1 um with 0.05 um of noise.
#pragma once

#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include "tests/hidden_effects/rig.h"
#include "tests/support/closed_loop.h"

namespace servotwin::test {

/// The poles of the closed loop without friction and cogging [rad/s], by frequency. Pairs once,
/// with positive imaginary part.
inline std::vector<std::complex<double>> poles_of(const hidden_effects::Rig& rig) {
  return closed_loop_poles({rig}, 0.0);
}

/// The lightly damped one [rad/s]; 0 where the axis is one body.
inline std::complex<double> mode_of(const hidden_effects::Rig& rig) {
  if (rig.body.spring_frequency_hz == 0.0) return 0.0;
  for (const auto& pole : poles_of(rig)) {
    if (pole.imag() > 0.0 && -pole.real() < 0.2 * std::abs(pole)) return pole;
  }
  return 0.0;
}

/// The axis as it is about this position of its table, where its spring does not move.
inline hidden_effects::Rig about(hidden_effects::Rig rig, double position) {
  const double stiffer = 1.0 + rig.body.spring_by_position * position;
  rig.body.spring_frequency_hz *= stiffer;
  rig.body.damping_ratio /= stiffer;
  rig.body.spring_by_position = 0.0;
  return rig;
}

inline hidden_effects::Rig two_masses(hidden_effects::Friction::Family family, double friction,
                                      double integral_time) {
  hidden_effects::Rig rig;
  rig.body.spring_frequency_hz = 45.0;
  rig.body.damping_ratio = 0.03;
  rig.body.motor_share = 0.7;
  rig.drive.velocity_gain = 2.0 * std::numbers::pi * 100.0 * rig.body.mass;
  rig.drive.position_gain = 40.0;
  rig.drive.integral_time = integral_time;
  rig.drive.position_from = rig.reading.recorded = hidden_effects::Encoder::kLoad;
  rig.friction.family = family;
  rig.friction.level = friction;
  rig.friction.viscous = 100.0;
  rig.reading.step = 1e-7;
  rig.reading.noise = 5e-8;
  return rig;
}

}  // namespace servotwin::test
