// A motor that carries masses on springs, without friction: as many modes as masses, and the poles
// that they have under control.
//
//   m0 x0'' = u - b x0' + sum_i c_i,   m_i x_i'' = -c_i,   c_i = k_i (x_i - x0) + d_i (x_i' - x0')
//   u = Kv (Kp (r - x0) - x0')
//
// Control acts at 8 kHz, its force is held in between: one exact step per period.
#pragma once

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <unsupported/Eigen/MatrixFunctions>
#include <utility>
#include <vector>

#include "identification/recording/segments.h"
#include "tests/hidden_effects/motion.h"
#include "tests/hidden_effects/random.h"
#include "tests/hidden_effects/rig.h"

namespace servotwin::test {

struct ManyMasses {
  double motor = 60.0, drag = 500.0;                             ///< [kg], [N s/m]
  double position_gain = 40.0;                                   ///< Kp [1/s]
  double velocity_gain = 2.0 * std::numbers::pi * 60.0 * 100.0;  ///< Kv [N s/m]
  struct Carried {
    double mass = 10.0, hz = 0.0, damping_ratio = 0.03;  ///< frequency with the motor held
  };
  std::vector<Carried> carried;

  /// x0, v0, x1, v1, .. over one control period: by the state, by r.
  [[nodiscard]] std::pair<Eigen::MatrixXd, Eigen::VectorXd> step() const {
    const auto n = 2 * static_cast<Eigen::Index>(carried.size() + 1);
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n + 1, n + 1);
    a(0, 1) = 1.0;
    a(1, 1) = -drag / motor;
    a(1, n) = 1.0 / motor;
    for (std::size_t i = 0; i < carried.size(); ++i) {
      const Eigen::Index x = 2 * static_cast<Eigen::Index>(i) + 2, v = x + 1;
      const double m = carried[i].mass, w = 2.0 * std::numbers::pi * carried[i].hz, k = m * w * w,
                   d = 2.0 * carried[i].damping_ratio * m * w;
      a(x, v) = 1.0;
      a(v, x) = -k / m, a(v, 0) = k / m, a(v, v) = -d / m, a(v, 1) = d / m;
      a(1, x) = k / motor, a(1, v) = d / motor;
      a(1, 0) -= k / motor, a(1, 1) -= d / motor;
    }
    const Eigen::MatrixXd held = (a / hidden_effects::kControlRate).exp();
    Eigen::RowVectorXd control = Eigen::RowVectorXd::Zero(n);
    control(0) = -velocity_gain * position_gain;
    control(1) = -velocity_gain;
    const Eigen::VectorXd force = held.topRightCorner(n, 1);
    return {held.topLeftCorner(n, n) + force * control, force * velocity_gain * position_gain};
  }

  /// The lightly damped ones [rad/s], by frequency, each pair once.
  [[nodiscard]] std::vector<std::complex<double>> modes() const {
    std::vector<std::complex<double>> out;
    for (const auto& value : step().first.eigenvalues()) {
      const std::complex<double> pole = std::log(value) * hidden_effects::kControlRate;
      if (pole.imag() > 0.0 && -pole.real() < 0.3 * std::abs(pole)) out.push_back(pole);
    }
    std::sort(out.begin(), out.end(),
              [](const auto& l, const auto& r) { return std::abs(l) < std::abs(r); });
    return out;
  }

  /// 1 kHz, an encoder of this step with half as much noise before it [m].
  [[nodiscard]] Segment follow(const hidden_effects::Command& command, double encoder_step) const {
    constexpr int kPerRow = 8;
    const auto [phi, by_command] = step();
    const auto rows = static_cast<Eigen::Index>(command.duration() * 1000.0);
    Segment out;
    out.sample_time_s = kPerRow / hidden_effects::kControlRate;
    out.command.resize(rows), out.actual.resize(rows);
    hidden_effects::Random random(3);
    Eigen::VectorXd state = Eigen::VectorXd::Zero(phi.rows());
    for (Eigen::Index i = 0; i < state.size(); i += 2) state(i) = command.at(0.0).position;
    for (Eigen::Index k = 0; k < rows * kPerRow; ++k) {
      const double r = command.at(static_cast<double>(k) / hidden_effects::kControlRate).position;
      if (k % kPerRow == 0) {
        out.command(k / kPerRow) = r;
        out.actual(k / kPerRow) =
            std::nearbyint(state(0) / encoder_step + 0.5 * random.normal()) * encoder_step;
      }
      state = phi * state + by_command * r;
    }
    return out;
  }
};

/// A mass of 20 kg and 1.5 % of damping at each of these frequencies [Hz].
inline ManyMasses carrying(const std::vector<double>& hz) {
  ManyMasses out;
  for (const double f : hz) out.carried.push_back({20.0, f, 0.015});
  return out;
}

/// 20 s of it, with jerks of 1500 m/s^3, behind an encoder of 10 nm.
inline Segment production_of(const ManyMasses& machine) {
  hidden_effects::Motion motion;
  motion.limits = {0.25, 8.0, 1500.0};
  hidden_effects::Random random(7);
  return machine.follow(hidden_effects::motion_of(motion, random), 1e-8);
}

}  // namespace servotwin::test
