// The rig against closed forms: with a wrong rig the benchmark would ask for effects that the
// recordings do not contain.
#include "tests/hidden_effects/rig.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>

#include "tests/hidden_effects/absorbed.h"

namespace servotwin::hidden_effects {
namespace {

using std::numbers::pi;
using virtual_machine::Limits;
using virtual_machine::Trajectory;

constexpr Limits kSmooth{.velocity = 0.1, .acceleration = 1.0, .jerk = 20.0};

/// No friction, no noise: 100 kg, Kp 100/s, velocity loop 500/s.
Rig plain() {
  Rig rig;
  rig.drive.position_gain = 100.0;
  rig.drive.velocity_gain = 50'000.0;
  return rig;
}

/// 0.2 s of rest, 0.1 m at 0.1 m/s, 0.5 s of rest.
Trajectory one_move() {
  Trajectory path(0.0);
  path.dwell(0.2);
  path.move_to(0.1, kSmooth);
  path.dwell(0.5);
  return path;
}

double error_at(const Trace& trace, double time, double sample_time = 1e-3) {
  const auto row = static_cast<std::size_t>(std::lround(time / sample_time));
  return trace.command[row] - trace.exact[row];
}

TEST(Rig, LagsAtConstantVelocityByWhatFeedForwardLeaves) {
  for (const double feedforward : {0.0, 0.6, 1.0}) {
    Rig rig = plain();
    rig.drive.velocity_feedforward = feedforward;
    rig.drive.integral_time = 0.01;
    // The velocity of two readings is that of half a period ago, which is the same here.
    EXPECT_NEAR(error_at(simulate(rig, one_move()), 0.8), 0.1 * (1.0 - feedforward) / 100.0, 1e-9)
        << feedforward;
  }
}

// F = m a + Fc at 0.5 m/s^2: in the unit and with the sign of the drive, behind its filter.
TEST(Rig, RecordsTheMotorsForceAsTheDriveGivesIt) {
  Rig rig = plain();
  rig.friction.level = 30.0;
  EXPECT_TRUE(simulate(rig, one_move()).torque.empty());
  rig.reading.torque_per_newton = -0.02;
  const Trace prompt = simulate(rig, one_move());
  ASSERT_EQ(prompt.torque.size(), prompt.command.size());
  const auto at = [](const Trace& trace, double time) {
    return trace.torque[static_cast<std::size_t>(std::lround(time / 1e-3))];
  };
  EXPECT_NEAR(at(prompt, 0.8), -0.02 * 30.0, 0.02 * 0.3) << "at constant speed";
  for (std::size_t row = 0; row < prompt.torque.size(); ++row)
    ASSERT_NEAR(prompt.torque[row], -0.02 * prompt.force[row], 1e-12) << row;

  // Behind a lag of 5 ms a force that grows steadily is read as it was 5 ms before.
  rig.reading.torque_lag = 5e-3;
  const Trace late = simulate(rig, one_move());
  EXPECT_NEAR(at(late, 0.235), at(prompt, 0.230), 0.02 * 1.0);
  EXPECT_GT(std::abs(at(late, 0.235) - at(prompt, 0.235)), 0.02 * 5.0);
}

// With drag and friction, and no integrator: e = (v (1 - kff) + (B v + Fc) / Kv) / Kp.
TEST(Rig, DragAndFrictionStandAgainstTheVelocityGain) {
  Rig rig = plain();
  rig.friction.level = 30.0;
  rig.friction.viscous = 200.0;
  EXPECT_NEAR(error_at(simulate(rig, one_move()), 0.8),
              (0.1 + (200.0 * 0.1 + 30.0) / 50'000.0) / 100.0, 1e-9);
  for (const auto family : {Friction::Family::kMaxwell, Friction::Family::kLuGre}) {
    rig.friction.family = family;  // after 50 mm all of them slide
    EXPECT_NEAR(error_at(simulate(rig, one_move()), 0.8),
                (0.1 + (200.0 * 0.1 + 30.0) / 50'000.0) / 100.0, 1e-9);
  }
  rig.friction.family = Friction::Family::kCoulomb;
  rig.friction.direction_ratio = 1.5;  // 1.2 and 0.8 times the mean
  EXPECT_NEAR(error_at(simulate(rig, one_move()), 0.8),
              (0.1 + 1.2 * (200.0 * 0.1 + 30.0) / 50'000.0) / 100.0, 1e-9);
}

// A step on the loop s^2 + a s + a Kp, a = Kv / m: closed form, sampled control apart (62.5 us for
// the held force and the same for the velocity of two readings, against 1 / a = 2 ms).
TEST(Rig, SwingsInAsTheContinuousLoop) {
  Rig rig = plain();
  rig.external_force.assign(8000, 500.0);  // from t = 0 on
  Trajectory rest(0.0);
  rest.dwell(0.5);
  const Trace trace = simulate(rig, rest);
  const double a = 500.0, b = a * 100.0, root = std::sqrt(a * a / 4.0 - b);
  const double fast = -a / 2.0 - root, slow = -a / 2.0 + root;
  const double settled = 500.0 / (100.0 * b);
  EXPECT_NEAR(trace.load[499], settled, 1e-9 * settled);
  for (const std::size_t ms : {5u, 10u, 20u, 40u}) {
    const double t = 1e-3 * static_cast<double>(ms);
    const double x =
        settled * (1.0 + (slow * std::exp(fast * t) - fast * std::exp(slow * t)) / (fast - slow));
    EXPECT_NEAR(trace.load[ms], x, 0.02 * settled) << ms;
  }
}

TEST(Rig, GravityIsHeldFromTheStart) {
  Trajectory rest(0.3);
  rest.dwell(0.3);
  Rig rig = plain();
  rig.body.constant_force = 400.0;
  Trace trace = simulate(rig, rest);
  for (const double force : trace.force) EXPECT_NEAR(force, 400.0, 1e-6);
  EXPECT_NEAR(error_at(trace, 0.2), 400.0 / (50'000.0 * 100.0), 1e-12);
  rig.drive.integral_time = 0.01;
  trace = simulate(rig, rest);
  EXPECT_NEAR(error_at(trace, 0.2), 0.0, 1e-12);
  EXPECT_NEAR(trace.force.back(), 400.0, 1e-6);
}

// Lost motion between the encoders, both ways: the gap, and the spring wound up by friction.
TEST(Rig, BacklashIsTheLostMotionBetweenTheEncoders) {
  Rig rig = plain();
  rig.friction.level = 40.0;
  rig.body.spring_frequency_hz = 400.0;
  rig.body.damping_ratio = 0.1;
  Trajectory path(0.0);
  path.dwell(0.1);
  path.move_to(0.05, kSmooth);
  path.dwell(0.2);
  path.move_to(0.0, kSmooth);
  path.dwell(0.2);
  const auto lost = [&](double gap) {
    rig.body.gap = gap;
    const Trace trace = simulate(rig, path);
    return (trace.motor[400] - trace.load[400]) - (trace.motor[1300] - trace.load[1300]);
  };
  ASSERT_NEAR(path.at(0.4).velocity, 0.1, 1e-9);
  ASSERT_NEAR(path.at(1.3).velocity, -0.1, 1e-9);
  const double stiffness = 60.0 * std::pow(2.0 * pi * 400.0, 2.0);
  EXPECT_NEAR(lost(0.0), 2.0 * 40.0 / stiffness, 1e-10);
  EXPECT_NEAR(lost(20e-6), 20e-6 + 2.0 * 40.0 / stiffness, 1e-10);
}

// With a loop far softer than the spring both masses oscillate freely against each other:
// f sqrt(1 + m2 / m1) of the free pair.
TEST(Rig, TwoMassesSwingAtTheirOwnFrequencies) {
  Rig rig = plain();
  rig.drive.position_gain = 0.1;
  rig.drive.velocity_gain = 1e-3;
  rig.body.spring_frequency_hz = 50.0;
  rig.body.damping_ratio = 0.001;
  rig.body.motor_share = 0.4;
  rig.external_force.assign(4, 5e4);  // an impulse
  rig.reading.sample_time = 1.25e-4;
  Trajectory rest(0.0);
  rest.dwell(1.0);
  const auto frequency_of = [&](bool held) {
    if (held) rig.drive.velocity_gain = 1e7, rig.body.motor_share = 0.999, rig.body.mass = 1e5;
    const Trace trace = simulate(rig, rest);
    int crossings = 0;
    double first = 0.0, last = 0.0;
    for (std::size_t i = 1; i < trace.load.size(); ++i) {
      const double before = trace.motor[i - 1] - trace.load[i - 1],
                   after = trace.motor[i] - trace.load[i];
      if (before >= 0.0 || after < 0.0) continue;
      last = (static_cast<double>(i) - after / (after - before)) * rig.reading.sample_time;
      if (crossings++ == 0) first = last;
    }
    return (crossings - 1) / (last - first);
  };
  EXPECT_NEAR(frequency_of(false), 50.0 * std::sqrt(1.0 + 0.6 / 0.4), 0.05);
  EXPECT_NEAR(frequency_of(true), 50.0, 0.1);  // with the motor held
}

// At a steady speed the motor holds the cogging: its force has that period in the position.
// At constant speed the spring carries the friction of the table alone, and the force all of it.
TEST(Rig, FrictionActsOnTheBodyThatHasIt) {
  for (const auto family : {Friction::Family::kCoulomb, Friction::Family::kMaxwell}) {
    for (const double share : {0.0, 0.3, 1.0}) {
      Rig rig = plain();
      rig.body.spring_frequency_hz = 60.0;
      rig.body.damping_ratio = 0.3;
      rig.friction.family = family;
      rig.friction.level = 40.0;
      rig.friction.motor_share = share;
      const Trace trace = simulate(rig, one_move());
      const std::size_t row = 900;
      const double stiffness =
          rig.body.mass * (1.0 - rig.body.motor_share) * std::pow(2.0 * pi * 60.0, 2);
      EXPECT_NEAR((trace.motor[row] - trace.load[row]) * stiffness, 40.0 * (1.0 - share), 0.4);
      EXPECT_NEAR(trace.force[row], 40.0, 0.4);
    }
  }
}

TEST(Rig, CoggingIsInTheForceAtItsPeriod) {
  Rig rig = plain();
  rig.drive.integral_time = 0.01;
  rig.body.cogging = 5.0;
  rig.body.cogging_period = 0.01;  // 1 Hz at 10 mm/s, far below the loop
  Trajectory path(0.0);
  path.dwell(0.1);
  path.move_to(0.1, {.velocity = 0.01, .acceleration = 1.0, .jerk = 50.0});
  const Trace trace = simulate(rig, path);
  double sine = 0.0, cosine = 0.0;
  const std::size_t begin = 2000, end = 8000;  // six periods
  for (std::size_t i = begin; i < end; ++i) {
    const double angle = 2.0 * pi * trace.motor[i] / 0.01;
    sine += trace.force[i] * std::sin(angle) * 2.0 / static_cast<double>(end - begin);
    cosine += trace.force[i] * std::cos(angle) * 2.0 / static_cast<double>(end - begin);
  }
  EXPECT_NEAR(std::hypot(sine, cosine), 5.0, 0.02);
  EXPECT_LT(sine, 0.0);  // against it
}

TEST(Rig, TheRecordLagsByTheDelay) {
  Rig rig = plain();
  const Trace prompt = simulate(rig, one_move());
  rig.reading.delay = 0.004;
  const Trace late = simulate(rig, one_move());
  for (std::size_t i = 4; i < prompt.exact.size(); ++i) {
    ASSERT_NEAR(late.exact[i], prompt.exact[i - 4], 1e-15) << i;
    ASSERT_EQ(late.command[i], prompt.command[i]);
  }
}

// Force over acceleration, in both halves of a record in which the mass grows.
TEST(Rig, AHeavierTableTakesMoreForce) {
  Rig rig = plain();
  rig.body.mass_ratio = 1.5;
  rig.body.mass_time = 1.0;
  Trajectory path(0.0);
  path.dwell(0.1);
  path.move_to(0.02, {.velocity = 1.0, .acceleration = 0.5, .jerk = 50.0});
  path.dwell(1.1 - path.duration());
  path.move_to(0.0, {.velocity = 1.0, .acceleration = 0.5, .jerk = 50.0});
  const Trace trace = simulate(rig, path);
  EXPECT_NEAR(trace.force[200] / trace.acceleration[1600], 100.0, 1.0);
  EXPECT_NEAR(trace.force[1200] / trace.acceleration[9600], 150.0, 1.5);
}

TEST(Rig, OnlyALoadEncoderOutsideTheLoopSeesScrewAndTable) {
  Rig rig = plain();
  const Trace clean = simulate(rig, one_move());
  rig.reading.lead_error = 5e-6;
  rig.reading.lead_period = 0.01;
  rig.reading.growth = 1e-4;
  rig.reading.growth_time = 0.5;
  rig.reading.fixed_end = -0.2;
  EXPECT_EQ(simulate(rig, one_move()).exact, clean.exact);
  rig.reading.recorded = Encoder::kLoad;
  const Trace seen = simulate(rig, one_move());
  EXPECT_EQ(seen.load, clean.load);
  for (const std::size_t i : {100u, 700u, 1500u}) {
    const double t = 1e-3 * static_cast<double>(i), x = seen.load[i];
    EXPECT_NEAR(
        seen.exact[i] - x,
        5e-6 * std::sin(2.0 * pi * x / 0.01) + 1e-4 * (x + 0.2) * (1.0 - std::exp(-t / 0.5)),
        1e-15);
  }
}

// Breakaway after rest: level and c ln(1 + t / t0) more, gone after some of its distance.
TEST(Rig, RestMakesStiction) {
  Rig rig = plain();
  rig.friction.level = 40.0;
  rig.friction.dwell_growth = 5.0;
  rig.friction.dwell_distance = 5e-5;
  rig.drive.velocity_gain = 3e5;  // follows whatever the force
  rig.reading.sample_time = 1.25e-4;
  Trajectory path(0.0);
  path.dwell(2.0);
  path.move_to(0.02, kSmooth);
  const Trace trace = simulate(rig, path);
  double most = 0.0;
  for (std::size_t i = 0; i < trace.force.size(); ++i) {
    const double t = static_cast<double>(i) * rig.reading.sample_time;
    most = std::max(most, trace.force[i] - 100.0 * path.at(t).acceleration);
  }
  EXPECT_NEAR(most, 40.0 + 5.0 * std::log(1.0 + 2.0 / 0.05), 2.0);
  EXPECT_NEAR(trace.force[static_cast<std::size_t>(2.19 / 1.25e-4)], 40.0, 0.5);
}

TEST(Rig, AnUnstableLoopRunsAwayInsteadOfMakingARecord) {
  Rig rig = plain();
  rig.drive.position_from = Encoder::kLoad;
  rig.body.spring_frequency_hz = 8.0;
  rig.body.damping_ratio = 0.001;
  const Trace wild = simulate(rig, one_move());
  EXPECT_TRUE(wild.runaway);
  EXPECT_EQ(rms_apart(wild, wild), kNever);
}

TEST(Rig, RefusesWhatIsNoMachine) {
  Rig rig = plain();
  rig.body.gap = 1e-5;  // of a rigid axis
  EXPECT_THROW((void)simulate(rig, one_move()), std::invalid_argument);
  rig = plain();
  rig.body.mass = 0.0;
  EXPECT_THROW((void)simulate(rig, one_move()), std::invalid_argument);
}

// Another gain is another tuning: nothing of it remains. Most of the effect of cogging remains.
TEST(Absorbed, TakesOutTuningAndLeavesCauses) {
  Rig rig = plain();
  rig.friction.level = 30.0;
  const Trajectory path = one_move();
  const Trace clean = simulate(rig, path);
  const Absorbed absorbed(rig, path, clean);
  Rig other = rig;
  other.drive.position_gain *= 1.002;
  const Trace tuned = simulate(other, path);
  EXPECT_LT(absorbed.left_rms(tuned, clean), 0.01 * rms_apart(tuned, clean));
  other = rig;
  other.body.cogging = 5.0;
  const Trace cogging = simulate(other, path);
  EXPECT_GT(absorbed.left_rms(cogging, clean), 0.9 * rms_apart(cogging, clean));
}

}  // namespace
}  // namespace servotwin::hidden_effects
