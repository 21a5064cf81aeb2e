// A mass under P position and P velocity control, simulated here, whose motor gives so much and no
// more. When it was at its limit is known from the simulation.
#include "identification/torque/torque_limit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace servotwin {
namespace {

constexpr double kRate_hz = 4000.0, kRecord_s = 1e-3, kMass = 100.0, kFriction = 20.0;

struct Machine {
  double limit = 1e9;           // [N]
  double acceleration = 2.0;    // of the moves [m/s^2]
  double ramp_s = 0.05;         // from no acceleration to all of it
  double torque_noise = 0.0;    // [N], of the measurement
  double encoder_noise = 1e-7;  // [m]
  double velocity_feedforward = 1.0;
};

struct Recorded {
  Segment segment;
  std::vector<double> limited_s;  // when the motor was at its limit
};

/// There and back, with accelerations that rise, stay and fall.
double command_acceleration(double t, const Machine& machine) {
  constexpr double kHold_s = 0.1, kMove_s = 2.0;
  const double in_move = std::fmod(t, kMove_s), whole = 2.0 * machine.ramp_s + kHold_s;
  const auto pulse = [&](double s) {
    if (s < 0.0 || s > whole) return 0.0;
    return std::min({1.0, s / machine.ramp_s, (whole - s) / machine.ramp_s});
  };
  const double sign = std::fmod(t, 2.0 * kMove_s) < kMove_s ? 1.0 : -1.0;
  return sign * machine.acceleration * (pulse(in_move - 0.1) - pulse(in_move - 1.0));
}

Recorded recorded(const Machine& machine, double duration_s = 12.0) {
  constexpr double kGain = 60.0, kVelocityGain = 400.0 * kMass;
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  const auto steps = static_cast<Eigen::Index>(duration_s * kRate_hz);
  const auto every = static_cast<Eigen::Index>(kRate_hz * kRecord_s);
  const double h = 1.0 / kRate_hz;
  Recorded out;
  Segment& s = out.segment;
  s.sample_time_s = kRecord_s;
  s.command.resize(steps / every);
  s.actual.resize(steps / every);
  s.torque.resize(steps / every);
  double xr = 0.0, vr = 0.0, x = 0.0, v = 0.0;
  for (Eigen::Index k = 0; k < steps; ++k) {
    const double t = h * static_cast<double>(k);
    const double wanted =
        kVelocityGain * (kGain * (xr - x) + machine.velocity_feedforward * vr - v);
    const double force = std::clamp(wanted, -machine.limit, machine.limit);
    if (force != wanted) out.limited_s.push_back(t);
    if (k % every == 0) {
      s.command(k / every) = xr;
      s.actual(k / every) = x + machine.encoder_noise * normal(random);
      s.torque(k / every) = force + machine.torque_noise * normal(random);
    }
    v += h * (force - kFriction * std::tanh(v / 1e-3)) / kMass;
    x += h * v;
    vr += h * command_acceleration(t, machine);
    xr += h * vr;
  }
  return out;
}

/// The share of these times that lie within a moment, to a sample.
double share_within(const std::vector<double>& times, const TorqueLimit& limit) {
  const auto within = [&](double t) {
    return std::any_of(limit.moments.begin(), limit.moments.end(), [&](const auto& moment) {
      return t > moment.begin_s - 1.5 * kRecord_s && t < moment.end_s + 1.5 * kRecord_s;
    });
  };
  return static_cast<double>(std::count_if(times.begin(), times.end(), within)) /
         static_cast<double>(times.size());
}

class AMotorAtItsLimit : public testing::TestWithParam<double> {};

TEST_P(AMotorAtItsLimit, IsFoundWithItsLevelAndItsMoments) {
  Machine machine;
  machine.limit = 190.0;  // of 220 that acceleration and friction need
  machine.torque_noise = GetParam();
  const Recorded made = recorded(machine);
  ASSERT_GT(made.limited_s.size(), 100U);
  const TorqueLimit limit = torque_limit({made.segment});
  EXPECT_TRUE(limit.found());
  EXPECT_NEAR(limit.level, machine.limit, 0.005 * machine.limit + machine.torque_noise);
  EXPECT_GT(share_within(made.limited_s, limit), 0.95);
  EXPECT_NEAR(limit.duration_s(), static_cast<double>(made.limited_s.size()) / kRate_hz,
              0.1 * static_cast<double>(made.limited_s.size()) / kRate_hz);
}
INSTANTIATE_TEST_SUITE_P(NoiseOfItsTorque, AMotorAtItsLimit, testing::Values(0.0, 0.2, 1.0));

// For a few milliseconds, a per cent below what the moves need: the axis lacks next to nothing of
// its acceleration, but the control asks for more than the motor gives.
TEST(TorqueLimit, IsFoundWhereItIsHardlyReached) {
  Machine free;
  const Eigen::ArrayXd torque = recorded(free).segment.torque.abs();
  for (const double noise : {0.0, 0.2}) {
    Machine machine;
    machine.limit = 0.99 * torque.maxCoeff();
    machine.torque_noise = noise;
    const Recorded made = recorded(machine);
    ASSERT_GT(made.limited_s.size(), 20U);
    const TorqueLimit limit = torque_limit({made.segment});
    EXPECT_TRUE(limit.found()) << noise;
    EXPECT_NEAR(limit.level, machine.limit, 0.002 * machine.limit) << noise;
    double lacking = 0.0;
    for (const TorqueLimit::Piece& piece : limit.pieces) lacking = std::max(lacking, piece.lacking);
    EXPECT_LT(lacking, 0.1) << "the acceleration shows it too";
    ASSERT_GE(limit.moments.size(), 4U) << "of both directions";
    for (const TorqueLimit::Moment& moment : limit.moments) EXPECT_GT(moment.beyond, 0.01);
  }
}

// The same in pieces, with a gap in the middle of a motion and times that do not begin at 0.
TEST(TorqueLimit, IsFoundInSegmentsThatBeginAndEndInMotion) {
  Machine machine;
  machine.limit = 0.99 * recorded({}).segment.torque.abs().maxCoeff();
  const Segment whole = recorded(machine).segment;
  std::vector<Segment> parts;
  for (const Eigen::Index from : {Eigen::Index{0}, whole.size() / 2 + 170}) {
    const Eigen::Index size = whole.size() / 2 - 170;
    Segment& part = parts.emplace_back();
    part.sample_time_s = whole.sample_time_s;
    part.start_s = 100.0 + whole.sample_time_s * static_cast<double>(from);
    part.command = whole.command.segment(from, size);
    part.actual = whole.actual.segment(from, size);
    part.torque = whole.torque.segment(from, size);
  }
  const TorqueLimit limit = torque_limit(parts);
  EXPECT_TRUE(limit.found());
  EXPECT_LT(limit.law_error, 1.1 * torque_limit({whole}).law_error);
  std::size_t asking = 0;
  for (const TorqueLimit::Moment& moment : limit.moments) asking += moment.beyond > 0.01 ? 1U : 0U;
  EXPECT_GE(2 * asking, limit.moments.size());
}

// One moment alone may be a peak that the law does not reach.
TEST(TorqueLimit, OneMomentThatAsksForMoreIsNotEnough) {
  TorqueLimit limit;
  limit.level = 100.0;
  limit.flat = 0.9;
  limit.law_error = 0.002;
  limit.moments = {{1.0, 1.02, 0.05}};
  EXPECT_FALSE(limit.found());
  limit.moments.push_back({2.0, 2.02, 0.05});
  EXPECT_TRUE(limit.found());
  limit.law_error = 0.02;
  EXPECT_FALSE(limit.found()) << "within four times the error of the law";
  limit.law_error = 0.002;
  limit.moments.resize(5, {3.0, 3.001, kAbsent});
  EXPECT_FALSE(limit.found()) << "three of five are too short to be judged";
  limit.moments = {{1.0, 1.02, 0.05}, {2.0, 2.02, 0.0}, {3.0, 3.02, 0.0}};
  EXPECT_FALSE(limit.found()) << "most do not ask for more";
}

// Constant acceleration needs a constant torque: it is flat, and the axis follows.
TEST(TorqueLimit, AMoveAtConstantAccelerationIsNone) {
  for (const double noise : {0.0, 0.2, 1.0}) {
    Machine machine;
    machine.torque_noise = noise;
    EXPECT_FALSE(torque_limit({recorded(machine).segment}).found()) << noise;
    machine.encoder_noise = 2e-6;
    EXPECT_FALSE(torque_limit({recorded(machine).segment}).found()) << noise << ", coarse encoder";
  }
}

// An axis that is followed closely at rest and in motion, with the torque of its friction.
TEST(TorqueLimit, FrictionAtConstantSpeedIsNone) {
  for (const double noise : {0.0, 2.0, 5.0}) {
    Machine machine;
    machine.acceleration = 0.05;  // 5 N beside 20 of friction
    machine.torque_noise = noise;
    machine.encoder_noise = 2e-6;
    EXPECT_FALSE(torque_limit({recorded(machine).segment}).found()) << noise;
  }
}

// As a percentage in whole steps: every peak is flat.
TEST(TorqueLimit, ARoundedPeakOfACoarseTorqueIsNone) {
  for (const double step : {5.0, 20.0}) {
    Machine machine;
    machine.ramp_s = 0.002;
    machine.velocity_feedforward = 0.0;
    Segment segment = recorded(machine).segment;
    segment.torque = step * (segment.torque / step).round();
    EXPECT_FALSE(torque_limit({segment}).found()) << step;
    machine.ramp_s = 0.05;
    segment = recorded(machine).segment;
    segment.torque = step * (segment.torque / step).round();
    EXPECT_FALSE(torque_limit({segment}).found()) << step;
  }
}

// A flat torque in moves at constant acceleration, without the overshoot of feed-forward.
TEST(TorqueLimit, AnAxisThatFollowsSlowlyIsNone) {
  Machine machine;
  machine.velocity_feedforward = 0.0;
  machine.ramp_s = 0.15;
  for (const double noise : {1e-7, 2e-6}) {
    machine.encoder_noise = noise;
    const TorqueLimit limit = torque_limit({recorded(machine).segment});
    EXPECT_GT(limit.flat, 0.67) << "flat alone is no limit";
    EXPECT_FALSE(limit.found()) << noise;
  }
}

// A short peak is not followed, but it is not flat.
TEST(TorqueLimit, APeakThatTheAxisDoesNotFollowIsNone) {
  Machine machine;
  machine.ramp_s = 0.002;
  machine.velocity_feedforward = 0.0;
  EXPECT_FALSE(torque_limit({recorded(machine).segment}).found());
}

TEST(TorqueLimit, WithoutTorqueThereIsNone) {
  Segment segment = recorded({}).segment;
  segment.torque.resize(0);
  EXPECT_FALSE(torque_limit({segment}).found());
  EXPECT_FALSE(torque_limit({}).found());
}

TEST(TorqueLimit, WhatIsAwayFromItContainsNoneOfItsMoments) {
  Machine machine;
  machine.limit = 190.0;
  const Recorded made = recorded(machine);
  const TorqueLimit limit = torque_limit({made.segment});
  const std::vector<Segment> parts = away_from(limit, {made.segment});
  ASSERT_GT(parts.size(), 3U);
  Eigen::Index left = 0;
  for (const Segment& part : parts) {
    left += part.size() - part.lead;
    for (const double t : made.limited_s)
      EXPECT_FALSE(t > part.start_s + 2.0 * kRecord_s && t < part.end_s() - 2.0 * kRecord_s) << t;
  }
  EXPECT_GT(left, made.segment.size() / 2);
  EXPECT_EQ(parts.front().lead, 0);
  EXPECT_GT(parts[1].lead, 0) << "the loop was open before";
}

TEST(TorqueLimit, OfAnAxisThatIsAtItsLimitMostOfTheTimeNothingIsAway) {
  Machine machine;
  machine.limit = 60.0;
  const Recorded made = recorded(machine);
  TorqueLimit limit = torque_limit({made.segment});
  ASSERT_FALSE(limit.moments.empty());
  EXPECT_TRUE(away_from(limit, {made.segment}).empty());
}

}  // namespace
}  // namespace servotwin
