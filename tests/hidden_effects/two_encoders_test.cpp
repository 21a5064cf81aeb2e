// An axis with an encoder at the motor and one at the load is fitted to both. The machine shares no
// code with the twin.
#include <gmock/gmock.h>

#include <random>

#include "identification/loop/identify.h"
#include "tests/hidden_effects/brisk_moves.h"
#include "twin/twin.h"
#include "twin/two_mass_axis.h"

namespace servotwin::hidden_effects {
namespace {

// With a heavy motor a loop that is closed at the motor shows, by 13 in the logarithm of the
// likelihood (with a motor of 0.4 by less than 2). The load's encoder is taken where chance
// decides.
constexpr double kFrequency_hz = 45.0, kDamping = 0.05, kMotorShare = 0.6;
constexpr double kMotorNoise = 3e-7;
// Neither encoder knows where the other has its zero.
constexpr double kZero = 1.7e-3;

Rig sprung(Encoder closes) {
  Rig rig;
  rig.body.spring_frequency_hz = kFrequency_hz;
  rig.body.damping_ratio = kDamping;
  rig.body.motor_share = kMotorShare;
  rig.friction.level = 20.0;
  rig.friction.saturation_velocity = 1e-3;
  rig.drive.position_gain = 25.0;
  rig.drive.velocity_gain = 100.0 * 80.0;
  rig.drive.velocity_feedforward = 0.8;
  rig.drive.position_from = closes;
  rig.reading.recorded = Encoder::kLoad;
  rig.reading.noise = 1e-7;
  rig.reading.sample_time = 1e-3;
  return rig;
}

SegmentedAxis recorded(const Rig& rig) {
  SegmentedAxis axis = recorded_brisk_moves(rig, 6);
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise(kZero, kMotorNoise);
  for (double& value : axis.segments.front().actual_motor) value += noise(random);
  return axis;
}

class TwoEncoders : public testing::TestWithParam<Encoder> {};

TEST_P(TwoEncoders, OfOneAxisAreBothPredictedToTheirNoise) {
  const Rig rig = sprung(GetParam());
  IdentifyOptions options;
  options.method = Method::kJoint;
  options.masses = Masses::kTwo;
  const ModelRecord found = identify(recorded(rig), options).record;
  const Effect* effect = two_mass_of(found.model);
  ASSERT_NE(effect, nullptr);
  const TwoMassParameters axis = two_mass_parameters(*effect);
  EXPECT_EQ(axis.encoders, GetParam() == Encoder::kLoad ? Encoders::kLoad : Encoders::kOutside);
  EXPECT_LT(found.holdout.rms, 1.3 * rig.reading.noise);
  EXPECT_LT(found.holdout.motor_rms, 1.3 * kMotorNoise);
  EXPECT_NEAR(effect->shape[0] / kFrequency_hz, 1.0, 0.01);
  EXPECT_NEAR(axis.zeta / kDamping, 1.0, 0.1);
  EXPECT_NEAR(axis.load_share, 1.0 - kMotorShare, 0.05);
  EXPECT_NEAR(axis.friction_share, 1.0, 0.1);
}

INSTANTIATE_TEST_SUITE_P(Closing, TwoEncoders, testing::Values(Encoder::kMotor, Encoder::kLoad));

}  // namespace
}  // namespace servotwin::hidden_effects
