// Two masses from the poles of a loop and a vibration. The poles come from the equations of motion
// of motor and load in a cascade of position and velocity control, as a matrix of first order; the
// code under test has the polynomial.
#include "identification/loop/two_mass_poles.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <complex>
#include <numbers>
#include <vector>

#include "twin/two_mass_axis.h"

namespace servotwin {
namespace {

struct Machine {
  double position_gain, velocity_gain, reset, frequency_hz, zeta, load_share;
  bool load_in_loop;
};

std::vector<std::complex<double>> poles(const Machine& m) {
  const double w = 2.0 * std::numbers::pi * m.frequency_hz, load = m.load_share, motor = 1.0 - load;
  // Motor's position and velocity, the load's, and the integral of the velocity error.
  Eigen::Matrix<double, 5, 5> a = Eigen::Matrix<double, 5, 5>::Zero();
  Eigen::Matrix<double, 1, 5> pull, wanted_speed = Eigen::Matrix<double, 1, 5>::Zero();
  pull << w * w, 2.0 * m.zeta * w, -w * w, -2.0 * m.zeta * w, 0.0;  // on the load, per its mass
  wanted_speed(m.load_in_loop ? 2 : 0) = -m.position_gain;
  Eigen::Matrix<double, 1, 5> speed_error = wanted_speed;
  speed_error(1) -= 1.0;
  a(0, 1) = a(2, 3) = 1.0;
  a.row(1) = (m.velocity_gain * speed_error - load * pull) / motor;
  a(1, 4) = m.velocity_gain * m.reset / motor;
  a.row(3) = pull;
  a.row(4) = speed_error;
  const Eigen::VectorXcd values = a.eigenvalues();
  std::vector<std::complex<double>> out;
  for (const auto& value : values) {
    if (m.reset > 0.0 || std::abs(value) > 1e-6) out.push_back(value);
  }
  return out;
}

/// The least damped pair as a compliance, the others as the loop beside it.
Model vibrating(const Machine& m) {
  auto all = poles(m);
  const auto mode = *std::min_element(all.begin(), all.end(), [](const auto& l, const auto& r) {
    const auto damping = [](const std::complex<double>& p) {
      return p.imag() > 0.0 ? -p.real() / std::abs(p) : 2.0;
    };
    return damping(l) < damping(r);
  });
  std::erase_if(all, [&](const auto& p) { return std::abs(p.real() - mode.real()) < 1e-6; });
  std::vector<std::complex<double>> polynomial{1.0};
  for (const auto& root : all) {
    polynomial.push_back(0.0);
    for (std::size_t i = polynomial.size() - 1; i > 0; --i)
      polynomial[i] -= root * polynomial[i - 1];
  }
  Model out;
  out.sample_time_s = 1e-3;
  out.loop.order = static_cast<int>(all.size());
  for (std::size_t i = 0; i < all.size(); ++i) out.loop.denominator[i] = polynomial[i + 1].real();
  out.loop.numerator[out.loop.order == 2 ? 1 : 2] = 0.7 * out.loop.denominator[0];
  Effect compliance;
  compliance.kind = kind_of<Compliance>();
  compliance.shape[0] = std::abs(mode) / (2.0 * std::numbers::pi);
  compliance.shape[1] = -mode.real() / std::abs(mode);
  out.effects.push_back(compliance);
  return out;
}

Model without_effects(Model model) {
  model.effects.clear();
  return model;
}

void expect_found(const Machine& m, std::size_t kind, double tolerance) {
  const Model start = vibrating(m);
  // The rigid fit has other gains; its lag at low frequencies and its friction are kept.
  Model rigid = without_effects(start);
  for (double& gain : rigid.loop.denominator) gain *= 3.0;
  Effect friction;
  friction.kind = kind_of<CoulombFriction>();
  friction.shape[0] = 1e-4;
  friction.coefficient[0] = 0.4;
  rigid.effects.push_back(friction);
  const auto found = two_masses_with_poles_of(start, rigid, kind);
  ASSERT_TRUE(found);
  const TwoMassParameters two = two_mass_parameters(*two_mass_of(*found));
  EXPECT_NEAR(two.omega / (2.0 * std::numbers::pi * m.frequency_hz), 1.0, tolerance);
  EXPECT_NEAR(two.load_share, m.load_share, tolerance);
  const auto& gain = found->loop.denominator;
  EXPECT_NEAR(gain[0] / m.velocity_gain, 1.0, tolerance);
  EXPECT_NEAR(gain[1] / (m.velocity_gain * (m.position_gain + m.reset)), 1.0, tolerance);
  EXPECT_NEAR(gain[2], m.velocity_gain * m.position_gain * m.reset, tolerance * gain[2]);
  if (m.load_in_loop && m.reset > 0.0) {
    EXPECT_NEAR(two.reset / m.reset, 1.0, tolerance);
  }
  const std::size_t last = m.reset > 0.0 ? 2 : 1;
  EXPECT_NEAR(found->loop.numerator[last] / gain[last],
              rigid.loop.numerator[last] / rigid.loop.denominator[last], 1e-12);
  EXPECT_NEAR(level_of(found->effects.front()) / gain[last], 0.4 / rigid.loop.denominator[last],
              1e-12);
}

TEST(TwoMassPoles, AreThoseOfTheMachine) {
  // A spring damped as in the catalogue: exact.
  expect_found({87.5, 419.0, 0.0, 57.8, 0.05, 0.7, true}, kind_of<TwoMassLoadEncoder>(), 1e-4);
  expect_found({60.0, 700.0, 0.0, 40.0, 0.05, 0.4, false}, kind_of<TwoMassMotorEncoder>(), 1e-4);
  expect_found({40.0, 500.0, 12.0, 70.0, 0.05, 0.5, true}, kind_of<TwoMassLoadEncoder>(), 1e-3);
  expect_found({40.0, 500.0, 12.0, 70.0, 0.05, 0.5, false}, kind_of<TwoMassMotorEncoder>(), 1e-3);
  // Position gain and reset alike: with the motor's encoder nothing tells them from each other.
  expect_found({40.0, 500.0, 40.0, 70.0, 0.05, 0.5, false}, kind_of<TwoMassMotorEncoder>(), 1e-3);
}

// In its loop this spring of 57.8 Hz and 0.02 is a vibration of 0.2, which is none of a machine.
TEST(TwoMassPoles, TellTheSpringFromItsVibrationInTheLoop) {
  const Machine m{87.5, 419.0, 0.0, 57.8, 0.02, 0.73, true};
  EXPECT_GT(vibrating(m).effects.front().shape[1], 0.15);
  expect_found(m, kind_of<TwoMassLoadEncoder>(), 0.1);
}

TEST(TwoMassPoles, AreNoneWithoutAComplianceBesideARigidLoopOfTheSameOrder) {
  const Model start = vibrating({87.5, 419.0, 0.0, 57.8, 0.05, 0.7, true});
  const Model rigid = without_effects(start);
  EXPECT_FALSE(two_masses_with_poles_of(rigid, rigid, kind_of<TwoMassLoadEncoder>()));
  EXPECT_FALSE(two_masses_with_poles_of(start, rigid, kind_of<PlayLoadEncoder>()));
  Model two = start;
  Effect spring;
  spring.kind = kind_of<TwoMassLoadEncoder>();
  two.effects.push_back(spring);
  EXPECT_FALSE(two_masses_with_poles_of(two, rigid, kind_of<TwoMassLoadEncoder>()));
  Model other = rigid;
  other.loop.order = 3;
  EXPECT_FALSE(two_masses_with_poles_of(start, other, kind_of<TwoMassLoadEncoder>()));
}

}  // namespace
}  // namespace servotwin
