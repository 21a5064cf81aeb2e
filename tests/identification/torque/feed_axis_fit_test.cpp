#include "identification/torque/feed_axis_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <random>

#include "tests/support/expect_error.h"
#include "twin/feed_axis/drive_control.h"
#include "twin/feed_axis/full_mechanics.h"
#include "twin/feed_axis/reversing_motion.h"
#include "twin/feed_axis/velocity_loop.h"

namespace servotwin {
namespace {

FeedAxisParts data_sheet() {
  FeedAxisParts parts;
  parts.screw = {.diameter = 0.032,
                 .lead = 0.032,
                 .length = 0.85,
                 .end_diameter = 0.025,
                 .end_length = 0.112,
                 .axial = {1.0, 5e-6},
                 .torsional = {1.0, 5e-6},
                 .elements = 16};
  parts.bearing = {19e8, 3.8e4};
  parts.coupling = {{17800.0, 0.36}, 114e-6};
  parts.nut = {{3e8, 6e3}, 0.20, 0.65, 0.22};
  parts.motor_inertia = 593e-6;
  parts.table_mass = 106.0;
  parts.control.position_gain = 60.0;
  parts.control.velocity_gain = 1.5747;
  parts.control.reset_time = 0.01;
  return parts;
}

const FittedValue& value(const FeedAxisFit& fit, const std::string& name) {
  for (const FittedValue& one : fit.values)
    if (one.name == name) return one;
  throw std::logic_error(name);
}

// The response is of a finer mesh, with noise; the fit knows neither.
TEST(FeedAxisFit, FindsTheSpringsBehindAResponse) {
  FeedAxisParts built = data_sheet();
  built.screw.elements = 40;
  built.coupling.spring = {14000.0, 0.5};
  built.nut.spring = {2.4e8, 9e3};
  VelocityResponse response{logarithmic(5.0, 2000.0, 150), {}, 0.425};
  response.closed = closed_velocity_loop(built, response.nut, response.frequency_hz);
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise(0.0, 0.02);
  for (auto& one : response.closed) one *= std::complex<double>(1.0 + noise(random), noise(random));
  const FeedAxisFit fit = fit_response(data_sheet(), response);
  EXPECT_LT(fit.rms, 0.03);
  EXPECT_GT(fit.rms_before, 5.0 * fit.rms);
  EXPECT_NEAR(value(fit, "coupling.stiffness").value, 14000.0, 0.02 * 14000.0);
  EXPECT_NEAR(value(fit, "nut.stiffness").value, 2.4e8, 0.05 * 2.4e8);
  EXPECT_NEAR(value(fit, "nut.damping").value, 9e3, 0.1 * 9e3);
  EXPECT_LT(value(fit, "coupling.stiffness").deviation, 0.01);
}

/// A bristle of its own, dz/dt = v - |v| z / g by the trapezoidal rule.
struct Bristle {
  LuGreParts law;
  double z = 0.0;
  double step(double v, double h) {
    const double g = (law.coulomb + (law.breakaway - law.coulomb) *
                                        std::exp(-std::abs(v) / law.stribeck_velocity)) /
                     law.stiffness,
                 slip = std::abs(v) / g * h / 2.0, before = z;
    z = ((1.0 - slip) * before + v * h) / (1.0 + slip);
    return law.stiffness * (z + before) / 2.0 + law.damping * (z - before) / h + law.viscous * v;
  }
};

/// A log of the axis at 1 kHz, simulated with all unknowns of a finer mesh and friction four times
/// per cycle.
Segment recorded(FeedAxisParts parts, std::vector<Bristle> bristles) {
  constexpr int kSubsteps = 4, kPerRow = 16;
  parts.screw.elements = 20;
  parts.nut.to = 0.34;
  const BallScrew screw(parts);
  DriveControl control(parts.control, screw.radius);
  const double h = control.step_s() / kSubsteps;
  FullMechanics mechanics(screw, {parts.nut.from, parts.nut.to, 0.01}, h);
  Eigen::ArrayXd command(0);
  for (const auto& [speed, travel] : {std::pair{0.2, 0.05}, {0.03, 0.01}, {0.004, 0.0012}}) {
    const Eigen::ArrayXd more =
        sampled({.speed = speed, .travel = travel, .rest_s = 0.15}, parts.control.rate_hz);
    command.conservativeResize(command.size() + more.size());
    command.tail(more.size()) = more;
  }
  std::mt19937_64 random(5);
  std::normal_distribution<double> noise(0.0, 0.01);
  const Eigen::Index rows = (command.size() - 1) / kPerRow + 1;
  Segment out;
  out.sample_time_s = 1e-3;
  out.command = out.actual = out.torque = Eigen::ArrayXd(rows);
  for (Eigen::Index k = 0; k < command.size(); ++k) {
    const MechanicsState now = mechanics.state();
    const double torque = control.step(command(k), now.motor_position, now.motor_velocity);
    if (k % kPerRow == 0) {
      out.command(k / kPerRow) = command(k);
      out.actual(k / kPerRow) = now.motor_position;
      out.torque(k / kPerRow) = torque + noise(random);
    }
    for (int i = 0; i < kSubsteps; ++i) {
      double friction = 0.0;
      for (Bristle& bristle : bristles)
        friction += bristle.step(mechanics.state().table_velocity, h);
      mechanics.step(torque, friction, parts.nut.at_zero + mechanics.state().table_position);
    }
  }
  return out;
}

void expect_law(const FeedAxisFit& fit, const std::string& of, const LuGreParts& want, double level,
                double bristle) {
  const auto near = [&](const char* name, double true_value, double share) {
    const FittedValue& got = value(fit, of + "." + name);
    EXPECT_NEAR(got.value, true_value, share * true_value) << got.name << " +- " << got.deviation;
  };
  near("coulomb", want.coulomb, level);
  near("viscous", want.viscous, 5.0 * level);
  near("breakaway", want.breakaway, 5.0 * level);
  near("stiffness", want.stiffness, bristle);
  near("damping", want.damping, bristle);
}

TEST(FeedAxisFit, FindsFrictionThenCoverFromTheTorque) {
  const LuGreParts drive{200.0, 163.0, 2.53e-3, 9.37e6, 4.45e4, 530.0},
      cover{49.6, 106.0, 5.3e-4, 1.92e6, 5.78e3, 86.2};
  FeedAxisParts parts = data_sheet();
  parts.friction = LuGreParts{150.0, 120.0, 5e-3, 5e6, 2e4, 300.0};
  const FeedAxisFit bare =
      fit_friction(parts, FrictionOf::kDrive, {recorded(data_sheet(), {{drive}})});
  EXPECT_LT(bare.rms, 0.015);
  EXPECT_GT(bare.rms_before, 0.1);
  expect_law(bare, "friction", drive, 0.01, 0.1);

  parts = bare.parts;
  parts.cover = LuGreParts{80.0, 80.0, 1e-3, 4e6, 1e4, 150.0};
  const FeedAxisFit both =
      fit_friction(parts, FrictionOf::kCover, {recorded(data_sheet(), {{drive}, {cover}})});
  EXPECT_LT(both.rms, 0.015);
  expect_law(both, "cover", cover, 0.02, 0.2);
  EXPECT_EQ(both.parts.friction->coulomb, bare.parts.friction->coulomb);  // held
}

TEST(FeedAxisFit, RefusesWhatCannotBeFitted) {
  FeedAxisParts parts = data_sheet();
  const Segment row = recorded(parts, {});
  test::expect_error<std::runtime_error>(
      [&] { (void)fit_friction(parts, FrictionOf::kDrive, {row}); },
      {"no friction as a start value"});
  parts.friction = LuGreParts{150.0, 120.0, 5e-3, 5e6, 0.0, 300.0};
  test::expect_error<std::runtime_error>(
      [&] { (void)fit_friction(parts, FrictionOf::kDrive, {row}); }, {"friction.damping is 0"});
  parts.friction->damping = 1e4;
  Segment silent = row;
  silent.torque.resize(0);
  test::expect_error<std::runtime_error>(
      [&] { (void)fit_friction(parts, FrictionOf::kDrive, {silent}); }, {"has no torque"});
}

}  // namespace
}  // namespace servotwin
