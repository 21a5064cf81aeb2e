// An axis of two masses on a spring (tests/hidden_effects/rig.h) and the poles it really has.
//
// A table of 30 kg at 45 Hz and 3 % of damping in front of a motor of 70 kg, its encoder in the
// position loop, friction on the table; encoder of 0.1 um with 0.05 um of noise.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <unsupported/Eigen/MatrixFunctions>
#include <vector>

#include "tests/hidden_effects/rig.h"

namespace servotwin::test {

/// The poles of the closed loop without friction and cogging [rad/s], by frequency: the rig's
/// equations over one control period in closed form, and the logarithm of their eigenvalues. Pairs
/// once, with positive imaginary part.
inline std::vector<std::complex<double>> poles_of(const hidden_effects::Rig& rig) {
  const auto& b = rig.body;
  const auto& d = rig.drive;
  const double m1 = b.motor_share * b.mass, m2 = b.mass - m1;
  const double held = 2.0 * std::numbers::pi * b.spring_frequency_hz;
  const double k = m2 * held * held, damper = 2.0 * b.damping_ratio * m2 * held;
  const double drag = 0.5 * rig.friction.viscous, period = 1.0 / hidden_effects::kControlRate;
  // x1, v1, x2, v2 and the held force.
  Eigen::Matrix<double, 5, 5> a = Eigen::Matrix<double, 5, 5>::Zero();
  a(0, 1) = a(2, 3) = 1.0;
  a.row(1) << -k / m1, -(damper + drag) / m1, k / m1, damper / m1, 1.0 / m1;
  a.row(3) << k / m2, damper / m2, -k / m2, -(damper + drag) / m2, 0.0;
  const Eigen::Matrix<double, 5, 5> step = (a * period).exp();
  // u = Kv (-Kp y - v1) + I,  I' = Kv / Tn (-Kp y - v1)
  const int y = d.position_from == hidden_effects::Encoder::kLoad ? 2 : 0;
  Eigen::RowVectorXd velocity_error = Eigen::RowVectorXd::Zero(5);
  velocity_error(y) -= d.position_gain;
  velocity_error(1) -= 1.0;
  const bool integral = d.integral_time > 0.0;
  Eigen::MatrixXd map = Eigen::MatrixXd::Zero(5, 5);  // x1, v1, x2, v2, I
  Eigen::RowVectorXd force = d.velocity_gain * velocity_error;
  force(4) = 1.0;
  map.topRows(4) =
      step.topRows(4).leftCols(4) * Eigen::MatrixXd::Identity(4, 5) + step.col(4).head(4) * force;
  map(4, 4) = 1.0;
  if (integral) map.row(4) += d.velocity_gain / d.integral_time * period * velocity_error;
  std::vector<std::complex<double>> out;
  const Eigen::Index size = integral ? 5 : 4;
  for (const auto& value : Eigen::MatrixXd(map.topLeftCorner(size, size)).eigenvalues()) {
    const std::complex<double> pole = std::log(value) / period;
    if (pole.imag() >= 0.0) out.push_back(pole);
  }
  std::sort(out.begin(), out.end(),
            [](const auto& l, const auto& r) { return std::abs(l) < std::abs(r); });
  return out;
}

/// The lightly damped one [rad/s]; 0 where the axis is one body.
inline std::complex<double> mode_of(const hidden_effects::Rig& rig) {
  if (rig.body.spring_frequency_hz == 0.0) return 0.0;
  for (const auto& pole : poles_of(rig)) {
    if (pole.imag() > 0.0 && -pole.real() < 0.2 * std::abs(pole)) return pole;
  }
  return 0.0;
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
