// What the integrator of a control does while the motor is at its limit. The machine shares no code
// with the twin.
#include <gmock/gmock.h>

#include <cmath>

#include "diagnosis/search/diagnose.h"
#include "identification/loop/output_error.h"
#include "identification/loop/torque_output.h"
#include "tests/hidden_effects/brisk_moves.h"
#include "twin/twin.h"

namespace servotwin::hidden_effects {
namespace {

constexpr int kRounds = 4;

/// An axis of 100 kg whose control asks for more force than its moves need: the integrator is first
/// led back at the limit, and then on.
Rig limited(IntegratorAtLimit form) {
  Rig rig;
  rig.friction.level = 20.0;
  rig.friction.viscous = 100.0;
  rig.friction.saturation_velocity = 1e-3;
  rig.drive.position_gain = 20.0;
  rig.drive.velocity_gain = 100.0 * 120.0;
  rig.drive.integral_time = 0.03;
  rig.drive.velocity_feedforward = 0.7;
  rig.drive.acceleration_feedforward = 120.0;
  rig.drive.force_limit = 180.0;
  rig.drive.anti_windup = form;
  rig.drive.tracking_time = 0.01;
  rig.reading.noise = 2e-7;
  rig.reading.sample_time = 1e-3;
  return rig;
}

/// The model of this machine, from its parameters.
Model model_of(const Rig& rig, std::size_t limit) {
  const Drive& drive = rig.drive;
  const double m = rig.body.mass, kv = drive.velocity_gain / m, kp = drive.position_gain,
               reset = 1.0 / drive.integral_time, b = rig.friction.viscous / m,
               missing = kv * (1.0 - drive.velocity_feedforward);
  Model model;
  model.sample_time_s = rig.reading.sample_time;
  model.loop.order = 3;
  model.loop.denominator = {kv + b, kv * kp + kv * reset, kv * kp * reset};
  model.loop.numerator = {1.0 - drive.acceleration_feedforward / m, missing + b, missing * reset};
  Effect friction = make_effect<CoulombFriction>();
  friction.shape[0] = rig.friction.saturation_velocity;
  friction.coefficient[0] = rig.friction.level / m;
  Effect saturation;
  saturation.kind = limit;
  saturation.shape = {drive.force_limit / m, reset, b};
  if (limit == kind_of<TorqueSaturationBackCalculation>())
    saturation.shape[1] = drive.tracking_time;
  saturation.coefficient[0] = 1.0;
  model.effects = {friction, saturation};
  return model;
}

constexpr std::array kForms{IntegratorAtLimit::kClamping, IntegratorAtLimit::kHolding,
                            IntegratorAtLimit::kTracking};

class AnIntegratorAtTheLimit : public testing::TestWithParam<std::size_t> {};

TEST_P(AnIntegratorAtTheLimit, IsSimulatedToTheNoiseByItsOwnFormAlone) {
  const Rig rig = limited(kForms[GetParam()]);
  const SegmentedAxis axis = recorded_brisk_moves(rig, kRounds);
  for (std::size_t i = 0; i < kForms.size(); ++i) {
    const Model start = model_of(rig, kMotorLimits[i]);
    ASSERT_EQ(why_invalid(start), "");
    Structure structure;
    structure.order = 3;
    for (const Effect& effect : start.effects) structure.effects.push_back(effect.kind);
    const auto fit = output_error(axis.segments, structure, start);
    ASSERT_TRUE(fit);
    if (i == GetParam()) {
      EXPECT_LT(fit->sigma, 1.2 * rig.reading.noise);
    } else {
      EXPECT_GT(fit->sigma, 3.0 * rig.reading.noise) << identity_of(kMotorLimits[i]).id;
    }
  }
}

TEST_P(AnIntegratorAtTheLimit, GivesATorqueThatIsSimulatedToItsNoise) {
  constexpr double kPerNewton = -0.03, kNoise_n = 1.0;
  Rig rig = limited(kForms[GetParam()]);
  rig.reading.torque_per_newton = kPerNewton;
  rig.reading.torque_noise = kNoise_n;
  const SegmentedAxis axis = recorded_brisk_moves(rig, kRounds);
  const auto torque = motor_torque(model_of(rig, kMotorLimits[GetParam()]),
                                   {"A", 0.0, axis.segments, axis.segments})
                          .torque;
  ASSERT_TRUE(torque);
  EXPECT_NEAR(torque->by.scale / (kPerNewton * rig.body.mass), 1.0, 0.005);
  EXPECT_NEAR(torque->by.viscous / (kPerNewton * rig.friction.viscous), 1.0, 0.05);
  EXPECT_NEAR(torque->by.offset, 0.0, 0.1 * std::abs(kPerNewton) * kNoise_n);
  EXPECT_LT(torque->holdout_rms, 1.1 * std::abs(kPerNewton) * kNoise_n);
}

TEST_P(AnIntegratorAtTheLimit, IsFoundWithTheLimit) {
  constexpr virtual_machine::Limits kEasy{.velocity = 0.2, .acceleration = 1.0, .jerk = 40.0},
      kHard{.velocity = 0.3, .acceleration = 2.2, .jerk = 60.0};
  const Rig rig = limited(kForms[GetParam()]);
  virtual_machine::Trajectory path(0.0);
  for (int i = 0; i < 2 * kRounds; ++i) {
    path.dwell(0.3);
    path.move_to(0.02 * (1 + i % 3), i % 2 == 0 ? kHard : kEasy);
    path.dwell(0.2);
    path.move_to(-0.01 * (1 + i % 2), kEasy);
  }
  DiagnoseOptions options;
  options.identify.method = Method::kJoint;
  const Diagnosis diagnosis = diagnose(recorded_along(path, rig), options);
  ASSERT_FALSE(diagnosis.causes.empty());
  EXPECT_EQ(diagnosis.causes.size(), 1U);
  EXPECT_EQ(diagnosis.causes.front().id, "torque_saturation");
  const Effect* limit = motor_limit_of(diagnosis.extended.model);
  ASSERT_NE(limit, nullptr);
  // The search for a clamping control ends in another form's optimum.
  if (kForms[GetParam()] != IntegratorAtLimit::kClamping) {
    EXPECT_EQ(limit->kind, kMotorLimits[GetParam()]);
    const double truth = kForms[GetParam()] == IntegratorAtLimit::kTracking
                             ? rig.drive.tracking_time
                             : 1.0 / rig.drive.integral_time;
    EXPECT_NEAR(limit->shape[1] / truth, 1.0, 0.05);
  }
  EXPECT_NEAR(limit->shape[0] / (rig.drive.force_limit / rig.body.mass), 1.0, 0.02);
}

INSTANTIATE_TEST_SUITE_P(Forms, AnIntegratorAtTheLimit, testing::Range<std::size_t>(0, 3));

}  // namespace
}  // namespace servotwin::hidden_effects
