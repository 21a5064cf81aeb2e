// The motor's torque as a second output of an axis' model. The machine shares no code with the
// twin.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "identification/loop/identify.h"
#include "identification/loop/torque_output.h"
#include "tests/hidden_effects/brisk_moves.h"
#include "twin/twin.h"

namespace servotwin::hidden_effects {
namespace {

constexpr double kPerNewton = -0.02, kTorqueNoise_n = 2.0;
constexpr double kTorqueNoise = std::abs(kPerNewton) * kTorqueNoise_n;
constexpr int kRounds = 8;

Rig driven() {
  Rig rig;
  rig.friction.level = 30.0;
  rig.friction.viscous = 150.0;
  rig.friction.saturation_velocity = 1e-3;
  rig.drive.position_gain = 40.0;
  rig.drive.velocity_gain = 100.0 * 250.0;
  rig.drive.integral_time = 0.02;
  rig.drive.velocity_feedforward = 0.5;
  rig.reading.noise = 1e-7;
  rig.reading.torque_per_newton = kPerNewton;
  rig.reading.torque_noise = kTorqueNoise_n;
  rig.reading.torque_unit = "A";
  return rig;
}

SegmentedAxis without_torque(SegmentedAxis axis) {
  for (Segment& s : axis.segments) s.torque.resize(0);
  return axis;
}

IdentifyOptions joint(Masses masses = Masses::kRigid) {
  IdentifyOptions options;
  options.method = Method::kJoint;
  options.masses = masses;
  return options;
}
ModelRecord identified(const SegmentedAxis& axis, Masses masses = Masses::kRigid) {
  return identify(axis, joint(masses)).record;
}

/// Relative error of the level of friction.
double friction_missed_by(const ModelRecord& found, const Rig& rig) {
  double level = 0.0;
  for (const Effect& effect : found.model.effects) {
    if (is_friction_law(effect.kind)) level += level_of(effect);
  }
  return std::abs(level / (rig.friction.level / rig.body.mass) - 1.0);
}

TEST(TorqueOutput, OfARigidAxisIsPredictedToItsNoiseFromTheCommand) {
  const Rig rig = driven();
  const ModelRecord found = identified(recorded_brisk_moves(rig, kRounds));
  ASSERT_TRUE(found.torque);
  const MotorTorque& torque = *found.torque;
  EXPECT_EQ(torque.unit, "A");
  EXPECT_TRUE(torque.fitted_together);
  EXPECT_NEAR(torque.by.scale / (kPerNewton * rig.body.mass), 1.0, 0.005);
  EXPECT_NEAR(torque.by.viscous / (kPerNewton * rig.friction.viscous), 1.0, 0.1);
  EXPECT_LT(torque.holdout_rms, 1.1 * kTorqueNoise);
  EXPECT_LT(found.holdout.rms, 1.3 * rig.reading.noise);
}

TEST(TorqueOutput, OfTwoMassesIsPredictedToItsNoise) {
  Rig rig = driven();
  rig.body.spring_frequency_hz = 45.0;
  rig.drive.position_gain = 25.0;
  rig.drive.velocity_gain = 100.0 * 80.0;
  rig.drive.integral_time = 0.0;
  rig.friction.viscous = 100.0;
  const ModelRecord found = identified(recorded_brisk_moves(rig, kRounds), Masses::kTwo);
  ASSERT_TRUE(found.torque);
  EXPECT_NEAR(found.torque->by.scale / (kPerNewton * rig.body.mass), 1.0, 0.01);
  EXPECT_LT(found.torque->holdout_rms, 1.1 * kTorqueNoise);
}

TEST(TorqueOutput, OfAFilteredControlIsPredictedToItsNoise) {
  Rig rig = driven();
  rig.drive.command_filter_hz = 12.0;
  rig.reading.sample_time = 2e-3;
  const SegmentedAxis axis = recorded_brisk_moves(rig, kRounds);
  const ModelRecord found = identified(axis);
  ASSERT_NE(found.model.find(kind_of<ControlFilter>()), nullptr);
  ASSERT_TRUE(found.torque);
  EXPECT_NEAR(found.torque->by.scale / (kPerNewton * rig.body.mass), 1.0, 0.02);
  EXPECT_LT(found.torque->holdout_rms, 1.3 * kTorqueNoise);
  // The position alone does not tell the friction of this loop.
  EXPECT_LT(friction_missed_by(found, rig), 0.05);
  EXPECT_GT(friction_missed_by(identified(without_torque(axis)), rig), 0.5);
}

// A drive's display of the torque is slow.
TEST(TorqueOutput, BehindAFilterIsPredictedToItsNoise) {
  Rig rig = driven();
  rig.reading.torque_lag = 6e-3;
  const ModelRecord found = identified(recorded_brisk_moves(rig, kRounds));
  ASSERT_TRUE(found.torque);
  EXPECT_TRUE(found.torque->lag.filter);
  EXPECT_NEAR(found.torque->lag.s / rig.reading.torque_lag, 1.0, 0.1);
  EXPECT_NEAR(found.torque->by.scale / (kPerNewton * rig.body.mass), 1.0, 0.01);
  EXPECT_LT(found.torque->holdout_rms, 1.3 * kTorqueNoise);
}

// A friction in the torque that is none of the position's, more than the axis has itself: the
// position decides, with a coarse encoder as well.
TEST(TorqueOutput, ThatThePositionContradictsDoesNotMoveTheModel) {
  constexpr double kBrake_n = 40.0, kFull_mps = 5e-4;
  for (const double step : {0.0, 2e-5}) {
    Rig rig = driven();
    rig.reading.step = step;
    SegmentedAxis axis = recorded_brisk_moves(rig, 4);
    Segment& s = axis.segments.front();
    for (Eigen::Index k = 1; k + 1 < s.size(); ++k) {
      const double velocity = (s.command(k + 1) - s.command(k - 1)) / (2.0 * s.sample_time_s);
      s.torque(k) += kPerNewton * kBrake_n * std::clamp(velocity / kFull_mps, -1.0, 1.0);
    }
    const ModelRecord found = identified(axis);
    ASSERT_TRUE(found.torque);
    EXPECT_LT(friction_missed_by(found, rig), 0.06) << step;
    if (step == 0.0) continue;
    EXPECT_FALSE(found.torque->fitted_together);
    EXPECT_EQ(found.holdout.rms, identified(without_torque(axis)).holdout.rms);
  }
}

// The recorder's range ends at 60 % of the highest torque.
TEST(TorqueOutput, WhereItIsClippedIsLeftOut) {
  const Rig rig = driven();
  SegmentedAxis axis = recorded_brisk_moves(rig, kRounds);
  Eigen::ArrayXd& torque = axis.segments.front().torque;
  const double most = 0.6 * torque.abs().maxCoeff();
  torque = torque.max(-most).min(most);
  const ModelRecord found = identified(axis);
  ASSERT_TRUE(found.torque);
  EXPECT_GT(found.torque->at_limit_share, 0.01);
  EXPECT_NEAR(found.torque->by.scale / (kPerNewton * rig.body.mass), 1.0, 0.01);
  EXPECT_LT(found.torque->holdout_rms, 1.2 * kTorqueNoise);
}

// A coarse encoder hardly shows friction; the torque does.
TEST(TorqueOutput, TellsWhatACoarseEncoderDoesNot) {
  Rig rig = driven();
  rig.reading.step = 2e-5;
  rig.reading.noise = 0.0;
  const SegmentedAxis axis = recorded_brisk_moves(rig, 2);
  const double without = friction_missed_by(identified(without_torque(axis)), rig),
               with = friction_missed_by(identified(axis), rig);
  EXPECT_LT(with, 0.05);
  EXPECT_LT(with, 0.5 * without);
}

TEST(TorqueOutput, OfAnotherMotionIsNone) {
  SegmentedAxis axis = recorded_brisk_moves(driven(), kRounds);
  const ModelRecord alone = identified(without_torque(axis));
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise;
  for (double& value : axis.segments.front().torque) value = noise(random);
  const Identified with = identify(axis, joint());
  const ModelRecord& beside = with.record;
  EXPECT_FALSE(beside.torque);
  EXPECT_NE(with.no_torque.find("% of its scatter"), std::string::npos) << with.no_torque;
  axis.segments.front().torque.setConstant(1.25);
  EXPECT_NE(identify(axis, joint()).no_torque.find("does not change"), std::string::npos);
  EXPECT_EQ(beside.holdout.rms, alone.holdout.rms);
}

}  // namespace
}  // namespace servotwin::hidden_effects
