// The virtual axis against closed forms of its loop, and against the thesis study as a second
// truth.
#include "tests/virtual_machine/axis.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <complex>
#include <stdexcept>
#include <string>
#include <unsupported/Eigen/MatrixFunctions>

#include "tests/support/thesis_study.h"
#include "tests/virtual_machine/program.h"

namespace servotwin::virtual_machine {
namespace {

using Eigen::ArrayXd;
using Eigen::Vector2d;

Axis axis_with_integrator() {
  Axis axis;
  axis.body = {.mass = 200.0, .viscous = 700.0};
  axis.drive = {.position_gain = 60.0, .velocity_gain = 40000.0, .integral_gain = 4e6};
  return axis;
}

Axis axis_without_integrator() {
  Axis axis = axis_with_integrator();
  axis.drive.integral_gain = 0.0;
  return axis;
}

StickCoulomb coulomb(double level) { return {.level = {.coulomb = level, .breakaway = level}}; }

double rms(const ArrayXd& a) { return std::sqrt(a.square().mean()); }

/// The last sample before the deceleration of a long move at 0.05 m/s.
struct Cruise {
  AxisRecord record;
  Eigen::Index last;
};

Cruise cruise(const Axis& axis) {
  Trajectory trajectory;
  trajectory.move_to(0.1, {.velocity = 0.05, .acceleration = 2.0, .jerk = 100.0});
  return {record(axis, trajectory), static_cast<Eigen::Index>(0.99 * 0.1 / 0.05 / 1e-3)};
}

TEST(Axis, FollowsConstantVelocityWithTheErrorOfTheClosedForm) {
  for (const double feedforward : {0.0, 0.7, 1.0}) {
    Axis axis = axis_with_integrator();
    axis.drive.velocity_feedforward = feedforward;
    axis.body.constant_force = 30.0;
    axis.body.friction = coulomb(90.0);
    const auto [r, n] = cruise(axis);
    EXPECT_NEAR(r.command[n] - r.actual[n], 0.05 * (1.0 - feedforward) / 60.0, 1e-12);
    EXPECT_NEAR(r.torque[n], 700.0 * 0.05 + 90.0 + 30.0, 1e-6);
  }
}

TEST(Axis, WithoutIntegratorForcesLeaveAnError) {
  Axis axis = axis_without_integrator();
  axis.drive.velocity_feedforward = 0.7;
  axis.body.constant_force = 30.0;
  axis.body.friction = coulomb(90.0);
  const auto [r, n] = cruise(axis);
  EXPECT_NEAR(r.command[n] - r.actual[n],
              0.05 * 0.3 / 60.0 + (700.0 * 0.05 + 90.0 + 30.0) / (40000.0 * 60.0), 1e-12);
  // At first the load alone: 30 N over the stiffness of the loop.
  EXPECT_NEAR(r.command[0] - r.actual[0], 30.0 / (40000.0 * 60.0), 1e-15);
}

TEST(Axis, AccelerationFeedforwardCancelsTheInertia) {
  // With Kvff = 1, Maff = m and no viscous friction c0 = c1 = c2 = 0; what is left is the sampling.
  Axis axis = axis_with_integrator();
  axis.body.viscous = 0.0;
  Trajectory trajectory;
  trajectory.move_to(0.02, {.velocity = 0.05, .acceleration = 1.0, .jerk = 30.0});
  const AxisRecord without = record(axis, trajectory);
  axis.drive.velocity_feedforward = 1.0;
  axis.drive.acceleration_feedforward = 200.0;
  const AxisRecord with = record(axis, trajectory);
  EXPECT_LT(rms(with.command - with.actual), 0.02 * rms(without.command - without.actual));
}

TEST(Axis, StandsStillUnderLoadAndFriction) {
  for (Axis axis : {axis_with_integrator(), axis_without_integrator()}) {
    axis.body.constant_force = 40.0;
    axis.body.friction = gms_with_curve(90.0, 20e-6, 4.0, 6);
    const AxisRecord r = record(
        axis, [](double) { return Setpoint{.position = 0.3}; }, 0.5);
    EXPECT_LT((r.actual - r.actual[0]).abs().maxCoeff(), 1e-15);
    EXPECT_NEAR(r.torque[200], 40.0, 1e-9);
  }
}

TEST(Axis, StaticFrictionHoldsUntilTheLoopPullsItLoose) {
  // Without integrator a command step d pulls with Kv Kp d for ever.
  Axis axis = axis_without_integrator();
  axis.body.friction = coulomb(90.0);
  const double just = 90.0 / (40000.0 * 60.0);
  const auto step_to = [](double d) {
    return [d](double t) { return Setpoint{.position = t < 0.01 ? 0.0 : d}; };
  };
  const AxisRecord held = record(axis, step_to(0.999 * just), 1.0);
  EXPECT_EQ(held.actual.abs().maxCoeff(), 0.0);
  const AxisRecord loose = record(axis, step_to(1.05 * just), 1.0);
  EXPECT_GT(loose.actual[999], 0.0);
  // It stops where the pull no longer exceeds friction; not beyond twice the excess.
  EXPECT_LT(loose.actual[999], 0.11 * just);

  // The integrator adds Ki Kp d t: it breaks loose when Kv Kp d + Ki Kp d t = Fs.
  axis = axis_with_integrator();
  axis.recorder.sample_time = 1.0 / 8000.0;
  axis.body.friction = coulomb(90.0);
  const double d = 0.4 * just;
  const double loose_at = 0.01 + (90.0 - 40000.0 * 60.0 * d) / (4e6 * 60.0 * d);
  const AxisRecord r = record(axis, step_to(d), 0.1);
  Eigen::Index first = 0;
  while (r.actual[first] == 0.0) ++first;
  EXPECT_NEAR(static_cast<double>(first) / 8000.0, loose_at, 2.0 / 8000.0);
}

/// The sampled loop without friction, exact: the body by matrix exponential over one period.
ArrayXd exact_sampled_response(const Axis& axis, double step, int periods) {
  const double period = 1.0 / axis.drive.rate_hz;
  Eigen::Matrix3d m = Eigen::Matrix3d::Zero();
  m(0, 1) = 1.0;
  m(1, 1) = -axis.body.viscous / axis.body.mass;
  m(1, 2) = 1.0 / axis.body.mass;
  const Eigen::Matrix3d phi = (m * period).exp();
  Vector2d z = Vector2d::Zero();
  double last = 0.0;
  double integral = 0.0;
  ArrayXd x(periods);
  for (int k = 0; k < periods; ++k) {
    x[k] = z[0];
    const double w = axis.drive.position_gain * (step - z[0]) - (z[0] - last) / period;
    last = z[0];
    const double u = axis.drive.velocity_gain * w + integral;
    integral += axis.drive.integral_gain * period * w;
    z = phi.topLeftCorner<2, 2>() * z + phi.topRightCorner<2, 1>() * u;
  }
  return x;
}

TEST(Axis, StepResponseIsThatOfTheSampledLoop) {
  for (Axis axis : {axis_with_integrator(), axis_without_integrator()}) {
    axis.recorder.sample_time = 1.0 / axis.drive.rate_hz;
    const AxisRecord stepped = record(
        axis,
        [&](double t) { return Setpoint{.position = t < 0.5 / axis.drive.rate_hz ? 0.0 : 1e-3}; },
        800.0 / axis.drive.rate_hz);
    const ArrayXd exact = exact_sampled_response(axis, 1e-3, 800);
    EXPECT_LT((stepped.actual.tail(800) - exact).abs().maxCoeff(), 1e-15);
  }
}

TEST(Axis, StepResponseTendsToThatOfTheContinuousLoop) {
  // By matrix exponential of [x, v, I, r]; the last is the constant command.
  const double duration = 0.1;
  Axis axis = axis_with_integrator();
  const double m = axis.body.mass;
  Eigen::Matrix4d a = Eigen::Matrix4d::Zero();
  const Drive& d = axis.drive;
  a.row(0) << 0.0, 1.0, 0.0, 0.0;
  a.row(1) << -d.velocity_gain * d.position_gain / m, -(d.velocity_gain + axis.body.viscous) / m,
      1.0 / m, d.velocity_gain * d.position_gain / m;
  a.row(2) << -d.integral_gain * d.position_gain, -d.integral_gain, 0.0,
      d.integral_gain * d.position_gain;
  const Eigen::Matrix4d step = (a * 1e-3).exp();

  // The coefficients that continuous_loop states are those of this matrix.
  const ContinuousLoop loop = continuous_loop(axis);
  const Eigen::Matrix3d s = a.topLeftCorner<3, 3>();
  EXPECT_NEAR(loop.a1, -s.trace(), 1e-9);
  EXPECT_NEAR(loop.a2, 0.5 * (s.trace() * s.trace() - (s * s).trace()), 1e-6);
  EXPECT_NEAR(loop.a3, -s.determinant(), 1e-3);

  const auto distance = [&](double rate) {
    axis.drive.rate_hz = rate;
    const double start = 1.0 / rate;
    const AxisRecord r = record(
        axis, [&](double t) { return Setpoint{.position = t < 0.5 * start ? 0.0 : 1e-3}; },
        duration + 1e-3);
    Eigen::Vector4d z(0.0, 0.0, 0.0, 1e-3);
    z = (a * (1e-3 - start)).exp() * z;
    double worst = 0.0;
    for (Eigen::Index n = 1; n < r.actual.size(); ++n) {
      worst = std::max(worst, std::abs(r.actual[n] - z[0]));
      z = step * z;
    }
    return worst;
  };
  const double at_8 = distance(8000.0);
  const double at_16 = distance(16000.0);
  const double at_64 = distance(64000.0);
  EXPECT_LT(at_8, 0.04e-3);
  EXPECT_NEAR(at_8 / at_16, 2.0, 0.2);
  EXPECT_NEAR(at_16 / at_64, 4.0, 0.4);
}

TEST(Axis, ContinuousLoopExplainsTheErrorOfAMove) {
  // A sine, when its start has died away, is followed with the error N(jw) jw / P(jw).
  Axis axis = axis_with_integrator();
  axis.drive.velocity_feedforward = 0.4;
  axis.drive.acceleration_feedforward = 50.0;
  axis.drive.rate_hz = 64000.0;
  const ContinuousLoop loop = continuous_loop(axis);
  const double w = 2.0;  // rad/s
  const AxisRecord r = record(
      axis,
      [w](double t) {
        return Setpoint{std::sin(w * t), w * std::cos(w * t), -w * w * std::sin(w * t), 0.0};
      },
      6.0);
  const std::complex<double> s(0.0, w);
  const std::complex<double> transfer = (loop.c0 * s * s + loop.c1 * s + loop.c2) * s /
                                        (s * s * s + loop.a1 * s * s + loop.a2 * s + loop.a3);
  for (const Eigen::Index n : {5000, 5200, 5700}) {
    const double t = static_cast<double>(n) * 1e-3;
    const double expected = (transfer * std::exp(s * t)).imag();
    EXPECT_NEAR(r.command[n] - r.actual[n], expected, 2e-4 * std::abs(transfer));
  }
}

TEST(Axis, IntegrationStepDoesNotMatter) {
  Axis axis = axis_with_integrator();
  axis.body.friction = gms_with_curve(90.0, 20e-6, 4.0, 6);
  axis.recorder.sample_time = 0.6e-3;  // between the integration steps
  const Trajectory trajectory = moves({.duration = 2.0, .stroke = 0.02}, 3);
  const auto position = [&](int steps) {
    axis.drive.integration_steps = steps;
    return record(axis, trajectory).true_position;
  };
  const ArrayXd truth = position(128);
  const double at_10 = (position(10) - truth).abs().maxCoeff();
  const double at_16 = (position(16) - truth).abs().maxCoeff();
  EXPECT_LT(at_10, 1e-12);
  EXPECT_LT(at_16, 0.3e-12);
}

TEST(Axis, TendsToTheThesisStudy) {
  // The same plant and friction, per kilogram, in two schemes: a sampled drive over an event-cut
  // Runge-Kutta here, a continuous loop by matrix exponential there. The drive's sampling is of
  // first order, so that twice the result at 32 kHz less that at 16 kHz has it removed.
  const ThesisFriction f = thesis_friction();
  Gms gms;
  gms.level = {.coulomb = 286e-3, .breakaway = 286e-3};
  for (Eigen::Index i = 0; i < f.level.size(); ++i) {
    gms.stiffness.push_back(f.stiffness[i]);
    gms.share.push_back(f.level[i] / 286.0);
  }
  Axis axis;
  axis.body = {.mass = 1.0, .viscous = 2.6480805210107405, .friction = gms};
  axis.drive = {.position_gain = 75.0,
                .velocity_gain = 232.48630659250946,
                .integral_gain = 32000.85850853618};
  axis.recorder.sample_time = 0.6e-3;
  Trajectory trajectory;
  const Limits limits{.velocity = 96e-3, .acceleration = 451e-3, .jerk = 38.2};
  trajectory.dwell(0.2);
  for (int k = 1; k <= 18; ++k)
    trajectory.move_to((k % 2 == 1 ? 1e-3 : -1e-3) * 11.0 * k / 18.0, limits);
  trajectory.move_to(0.0, limits);
  trajectory.dwell(0.5);

  const auto run = [&](double rate) {
    axis.drive.rate_hz = rate;
    return record(axis, trajectory);
  };
  const ThesisStudy study = thesis_study(25e-6);
  const AxisRecord at_16 = run(16000.0);
  const AxisRecord at_32 = run(32000.0);
  ASSERT_EQ(at_16.command.size(), study.command_mm.size());
  EXPECT_LT((at_16.command - 1e-3 * study.command_mm).abs().maxCoeff(), 1e-15);
  const ArrayXd off_16 = at_16.actual - 1e-3 * study.actual_mm;
  const ArrayXd off_32 = at_32.actual - 1e-3 * study.actual_mm;
  EXPECT_NEAR(rms(off_16) / rms(off_32), 2.0, 0.05);
  EXPECT_LT(rms(2.0 * off_32 - off_16), 0.01e-6);
  EXPECT_LT((2.0 * off_32 - off_16).abs().maxCoeff(), 0.2e-6);
}

TEST(Axis, ForceLimitIsKeptAndDoesNotWindUp) {
  Axis axis = axis_with_integrator();
  axis.drive.force_limit = 100.0;
  axis.body.friction = coulomb(150.0);  // cannot move at all
  axis.recorder.sample_time = 1.0 / 8000.0;
  const AxisRecord r = record(
      axis,
      [](double t) { return Setpoint{.position = t < 0.01 ? 0.0 : (t < 1.0 ? 1e-3 : -1e-5)}; },
      1.1);
  EXPECT_EQ(r.torque.abs().maxCoeff(), 100.0);
  EXPECT_EQ(r.actual.abs().maxCoeff(), 0.0);
  EXPECT_EQ(r.torque[7900], 100.0);
  // The pull to the other side acts from the first period: the integrator holds no more than the
  // limit.
  EXPECT_LE(r.torque[8001], 100.0 - 40000.0 * 60.0 * 1e-5 + 1e-9);
}

TEST(Axis, EncoderReadsWholeSteps) {
  Axis axis = axis_with_integrator();
  axis.recorder.position_step = 1e-6;
  axis.body.friction = coulomb(90.0);
  const AxisRecord r = record(axis, moves({.duration = 3.0, .stroke = 0.05}, 11));
  const ArrayXd steps = r.actual / 1e-6;
  EXPECT_LT((steps - steps.round()).abs().maxCoeff(), 1e-6);
  const ArrayXd off = r.actual - r.true_position;
  EXPECT_LE(off.abs().maxCoeff(), 0.5e-6 + 1e-15);
  // Uniform within a step while it moves: RMS step / sqrt(12).
  const auto moving = r.true_velocity.abs() > 5e-3;
  const double count = static_cast<double>(moving.count());
  ASSERT_GT(count, 500.0);
  EXPECT_NEAR(std::sqrt(moving.select(off, 0.0).square().sum() / count), 1e-6 / std::sqrt(12.0),
              0.02e-6);
}

TEST(Axis, DriveFeelsItsEncoder) {
  // One step of 1 um more in one period reads as 8 mm/s: torque jumps by Kv (q rate + Kp q).
  Axis axis = axis_with_integrator();
  axis.drive.encoder_step = 1e-6;
  axis.recorder.sample_time = 1.0 / 8000.0;
  Trajectory trajectory;
  trajectory.move_to(0.002, {.velocity = 0.001, .acceleration = 1.0, .jerk = 100.0});
  const AxisRecord coarse = record(axis, trajectory);
  const ArrayXd jumps =
      (coarse.torque.tail(8000) - coarse.torque.segment(coarse.torque.size() - 8001, 8000)).abs();
  EXPECT_NEAR(jumps.maxCoeff(), 40000.0 * 1e-6 * (8000.0 + 60.0), 10.0);
  axis.drive.encoder_step = 1e-9;
  EXPECT_LT((record(axis, trajectory).actual - coarse.actual).abs().maxCoeff(), 2e-6);
}

TEST(Axis, DelayShiftsTheFeedbackAgainstTheCommand) {
  Axis axis = axis_with_integrator();
  axis.body.friction = gms_with_curve(90.0, 20e-6, 4.0, 6);
  const Trajectory trajectory = moves({.duration = 2.0, .stroke = 0.05}, 4);
  const AxisRecord prompt = record(axis, trajectory);
  axis.recorder.delay = 7e-3;
  const AxisRecord late = record(axis, trajectory);
  const Eigen::Index n = prompt.actual.size();
  ASSERT_EQ(late.actual.size(), n);
  EXPECT_EQ((late.command - prompt.command).abs().maxCoeff(), 0.0);
  EXPECT_LT((late.actual.tail(n - 7) - prompt.actual.head(n - 7)).abs().maxCoeff(), 1e-14);
  EXPECT_LT((late.torque.tail(n - 7) - prompt.torque.head(n - 7)).abs().maxCoeff(), 1e-9);
  EXPECT_EQ(late.actual.head(7).abs().maxCoeff(), 0.0);
}

TEST(Axis, RecordsTheSameMotionAtEveryRate) {
  Axis axis = axis_with_integrator();
  axis.body.friction = gms_with_curve(90.0, 20e-6, 4.0, 6);
  const Trajectory trajectory = moves({.duration = 3.0, .stroke = 0.05}, 8);
  axis.recorder.sample_time = 0.2e-3;
  const AxisRecord fine = record(axis, trajectory);
  for (const int every : {3, 5, 10, 20}) {  // 0.6, 1, 2, 4 ms
    axis.recorder.sample_time = 0.2e-3 * every;
    const AxisRecord r = record(axis, trajectory);
    EXPECT_EQ(r.actual.size(), (fine.actual.size() - 1) / every + 1);
    for (Eigen::Index n = 0; n < r.actual.size(); ++n) {
      ASSERT_NEAR(r.actual[n], fine.actual[n * every], 1e-14);
      ASSERT_NEAR(r.torque[n], fine.torque[n * every], 1e-9);
    }
  }
}

TEST(Axis, EnergyIsAccountedFor) {
  // Work of the motor = kinetic energy + viscous loss + work against friction and load.
  Axis axis = axis_with_integrator();
  axis.body.friction = gms_with_curve(90.0, 20e-6, 4.0, 6);
  axis.body.constant_force = 25.0;
  axis.recorder.sample_time = 1.0 / 64000.0;
  const AxisRecord r = record(axis, moves({.duration = 1.5, .stroke = 0.03}, 9));
  const Eigen::Index n = r.actual.size() - 1;
  const ArrayXd& v = r.true_velocity;
  const ArrayXd mean_v = 0.5 * (v.head(n) + v.tail(n));
  const double dt = axis.recorder.sample_time;
  const double motor =
      (r.torque.head(n) * (r.true_position.tail(n) - r.true_position.head(n))).sum();
  const double viscous = 700.0 * mean_v.square().sum() * dt;
  const double friction =
      (0.5 * (r.true_friction.head(n) + r.true_friction.tail(n)) * mean_v).sum() * dt;
  const double load = 25.0 * (r.true_position[n] - r.true_position[0]);
  const double kinetic = 0.5 * 200.0 * v[n] * v[n];
  EXPECT_GT(friction, 1.0);
  EXPECT_NEAR(motor, kinetic + viscous + friction + load, 1e-5 * motor);
}

TEST(Axis, NoiseComesFromTheSeed) {
  Axis axis = axis_with_integrator();
  axis.recorder.position_noise = 0.3e-6;
  axis.recorder.torque_noise = 0.5;
  const Trajectory trajectory = moves({.duration = 5.0, .stroke = 0.05}, 2);
  const AxisRecord a = record(axis, trajectory);
  const AxisRecord b = record(axis, trajectory);
  EXPECT_EQ((a.actual - b.actual).abs().maxCoeff(), 0.0);
  EXPECT_EQ((a.torque - b.torque).abs().maxCoeff(), 0.0);
  axis.recorder.seed = 2;
  EXPECT_GT((record(axis, trajectory).actual - a.actual).abs().maxCoeff(), 0.3e-6);
  EXPECT_NEAR(rms(a.actual - a.true_position), 0.3e-6, 0.01e-6);
  axis.recorder.torque_noise = 0.0;
  EXPECT_NEAR(rms(a.torque - record(axis, trajectory).torque), 0.5, 0.02);
}

TEST(Axis, TransmissionScalesTheRecordedTorque) {
  Axis axis = axis_with_integrator();
  const Trajectory trajectory = moves({.duration = 1.0, .stroke = 0.02}, 2);
  const AxisRecord force = record(axis, trajectory);
  axis.transmission = 0.02 / 6.283185307179586;
  EXPECT_LT((record(axis, trajectory).torque - force.torque * axis.transmission).abs().maxCoeff(),
            1e-12);
}

TEST(Axis, RefusesWhatItCannotSimulate) {
  const auto refusal = [](auto change) -> std::string {
    Axis axis = axis_with_integrator();
    change(axis);
    try {
      (void)record(
          axis, [](double) { return Setpoint{}; }, 0.1);
    } catch (const std::invalid_argument& e) {
      return e.what();
    }
    return "";
  };
  EXPECT_EQ(refusal([](Axis&) {}), "");
  EXPECT_EQ(refusal([](Axis& a) { a.drive.rate_hz = 4000.0; }),
            "axis X: drive.rate_hz is 4000.000000, must be at least 8000");
  EXPECT_NE(refusal([](Axis& a) { a.drive.integration_steps = 2; }).find("integration_steps"),
            std::string::npos);
  EXPECT_NE(refusal([](Axis& a) { a.drive.position_gain = 0.0; }).find("position_gain"),
            std::string::npos);
  EXPECT_NE(refusal([](Axis& a) { a.drive.integral_gain = -1.0; }).find("integral_gain"),
            std::string::npos);
  EXPECT_NE(refusal([](Axis& a) { a.drive.force_limit = 0.0; }).find("force_limit"),
            std::string::npos);
  EXPECT_NE(refusal([](Axis& a) { a.recorder.sample_time = 0.0; }).find("sample_time"),
            std::string::npos);
  EXPECT_NE(refusal([](Axis& a) { a.recorder.delay = -1e-3; }).find("delay"), std::string::npos);
  EXPECT_NE(refusal([](Axis& a) { a.body.mass = 0.0; }).find("mass"), std::string::npos);
}

}  // namespace
}  // namespace servotwin::virtual_machine
