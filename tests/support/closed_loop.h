// The poles that axes of tests/hidden_effects/rig.h really have, alone or pushing each other.
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

/// Without friction and cogging, each table pushed by `common_mass` [kg] times the acceleration
/// that the other one had a control period before: the rig's equations over one control period in
/// closed form, with its difference for the velocity, and the logarithm of their eigenvalues
/// [rad/s], by frequency. Pairs once, with positive imaginary part. One axis or two.
inline std::vector<std::complex<double>> closed_loop_poles(
    const std::vector<hidden_effects::Rig>& axes, double common_mass) {
  constexpr double kPeriod = 1.0 / hidden_effects::kControlRate;
  // Of each axis: x1, v1, x2, v2, the integral, x1 before, force and push of the period before.
  enum { kX1, kV1, kX2, kV2, kIntegral, kBefore, kForce, kPush, kStates };
  using Row = Eigen::RowVectorXd;
  const auto count = static_cast<Eigen::Index>(axes.size()), size = count * kStates;
  Eigen::MatrixXd map = Eigen::MatrixXd::Zero(size, size);
  std::vector<Eigen::Matrix<double, 6, 6>> steps;
  Eigen::MatrixXd acceleration = Eigen::MatrixXd::Zero(count, size);  // of the tables
  for (Eigen::Index i = 0; i < count; ++i) {
    const auto& body = axes[static_cast<std::size_t>(i)].body;
    const double drag = 0.5 * axes[static_cast<std::size_t>(i)].friction.viscous;
    // x1, v1, x2, v2, force on the motor and push on the table, both held.
    Eigen::Matrix<double, 6, 6> a = Eigen::Matrix<double, 6, 6>::Zero();
    a(kX1, kV1) = a(kX2, kV2) = 1.0;
    if (body.spring_frequency_hz > 0.0) {
      const double m1 = body.motor_share * body.mass, m2 = body.mass - m1;
      const double held = 2.0 * std::numbers::pi * body.spring_frequency_hz;
      const double k = m2 * held * held, damper = 2.0 * body.damping_ratio * m2 * held;
      a.row(kV1) << -k / m1, -(damper + drag) / m1, k / m1, damper / m1, 1.0 / m1, 0.0;
      a.row(kV2) << k / m2, damper / m2, -k / m2, -(damper + drag) / m2, 0.0, 1.0 / m2;
    } else {
      const double m = body.mass;
      a.row(kV1) << 0.0, -2.0 * drag / m, 0.0, 0.0, 1.0 / m, 1.0 / m;
      a.row(kV2) << 0.0, 0.0, 0.0, -2.0 * drag / m, 1.0 / m, 1.0 / m;
    }
    steps.emplace_back((a * kPeriod).exp());
    acceleration.block(i, i * kStates, 1, 4) = a.row(kV2).head(4);
    acceleration(i, i * kStates + kForce) = a(kV2, 4);
    acceleration(i, i * kStates + kPush) = a(kV2, 5);
  }
  for (Eigen::Index i = 0; i < count; ++i) {
    const auto& rig = axes[static_cast<std::size_t>(i)];
    const auto& drive = rig.drive;
    const Eigen::Index at = i * kStates;
    // u = Kv e + I,  e = -Kp y - v,  I' = Kv / Tn e
    const bool on_load = drive.position_from == hidden_effects::Encoder::kLoad;
    Row error = Row::Zero(size);
    error(at + (on_load ? kX2 : kX1)) -= drive.position_gain;
    error(at + kX1) -= 1.0 / kPeriod;
    error(at + kBefore) += 1.0 / kPeriod;
    Row force = drive.velocity_gain * error;
    force(at + kIntegral) += 1.0;
    const Row push = count == 2 ? Row(common_mass * acceleration.row(1 - i)) : Row(Row::Zero(size));
    const auto& step = steps[static_cast<std::size_t>(i)];
    map.block(at, at, 4, 4) += step.topLeftCorner(4, 4);
    map.middleRows(at, 4) += step.col(4).head(4) * force + step.col(5).head(4) * push;
    map(at + kIntegral, at + kIntegral) = 1.0;
    if (drive.integral_time > 0.0)
      map.row(at + kIntegral) += drive.velocity_gain / drive.integral_time * kPeriod * error;
    map(at + kBefore, at + kX1) = 1.0;
    map.row(at + kForce) = force;
    map.row(at + kPush) = push;
  }
  // What is no state of the loop is at 0 or 1, or beyond the control's own rate.
  std::vector<std::complex<double>> out;
  for (const auto& value : map.eigenvalues()) {
    if (std::abs(value) < 0.1 || std::abs(value - 1.0) < 1e-9) continue;
    const std::complex<double> pole = std::log(value) / kPeriod;
    if (pole.imag() >= 0.0) out.push_back(pole);
  }
  std::sort(out.begin(), out.end(),
            [](const auto& l, const auto& r) { return std::abs(l) < std::abs(r); });
  return out;
}

}  // namespace servotwin::test
