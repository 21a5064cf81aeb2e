// A filter of the command and a current loop that lags: every control has something like it, and
// it is no fault. The machine shares no code with the twin.
#include <gmock/gmock.h>

#include <algorithm>

#include "diagnosis/search/diagnose.h"
#include "identification/loop/identify.h"
#include "tests/hidden_effects/brisk_moves.h"

namespace servotwin::hidden_effects {
namespace {

/// A healthy axis of 100 kg with an integrator, whose command passes a filter of 12 Hz and whose
/// current follows 2 ms late.
Rig filtered() {
  Rig rig;
  rig.friction.level = 30.0;
  rig.friction.saturation_velocity = 1e-3;
  rig.drive.position_gain = 40.0;
  rig.drive.velocity_gain = 100.0 * 250.0;
  rig.drive.integral_time = 0.02;
  rig.drive.command_filter_hz = 12.0;
  rig.drive.current_lag = 2e-3;
  rig.reading.noise = 5e-8;
  rig.reading.sample_time = 2e-3;
  return rig;
}

TEST(ControlFilter, IsIdentifiedAndPredictsToTheNoise) {
  const Rig rig = filtered();
  const SegmentedAxis axis = recorded_brisk_moves(rig, 8);
  IdentifyOptions options;
  options.method = Method::kJoint;
  const ModelRecord with = identify(axis, options).record;
  ASSERT_NE(with.model.find(kind_of<ControlFilter>()), nullptr);
  EXPECT_LT(with.holdout.rms, 1.5 * rig.reading.noise);
  options.beyond_loop = false;
  EXPECT_GT(identify(axis, options).record.holdout.rms, 5.0 * rig.reading.noise);
}

TEST(ControlFilter, IsNoCause) {
  const Rig rig = filtered();
  DiagnoseOptions options;
  options.identify.method = Method::kJoint;
  const Diagnosis diagnosis = diagnose(recorded_brisk_moves(rig, 8), options);
  for (const Cause& cause : diagnosis.causes) EXPECT_EQ(cause.id, "");
  EXPECT_EQ(diagnosis.verdict, Verdict::kNothingSignificant);
  EXPECT_LT(diagnosis.baseline.holdout.rms, 1.5 * rig.reading.noise);
}

// Force ripple leaves twice the floor and more, so that a filter is tried; it explains none of it.
TEST(ControlFilter, IsNotAddedForWhatItIsNot) {
  Rig rig = filtered();
  rig.drive.command_filter_hz = 0.0;
  rig.drive.current_lag = 0.0;
  rig.body.cogging = 8.0;
  IdentifyOptions options;
  options.method = Method::kJoint;
  const Identified found = identify(recorded_brisk_moves(rig, 8), options);
  EXPECT_EQ(found.record.model.find(kind_of<ControlFilter>()), nullptr);
  const bool tried = std::any_of(found.trials.begin(), found.trials.end(), [](const auto& trial) {
    const auto& effects = trial.effects;
    return std::find(effects.begin(), effects.end(), kind_of<ControlFilter>()) != effects.end();
  });
  EXPECT_TRUE(tried);
}

// A filter is asked for before play is named; it must not stand for play that is there.
TEST(ControlFilter, PlayBesideItIsNamed) {
  Rig rig = filtered();
  rig.body.spring_frequency_hz = 120.0;
  rig.body.damping_ratio = 0.2;
  rig.body.gap = 2e-5;
  DiagnoseOptions options;
  options.identify.method = Method::kJoint;
  const Diagnosis diagnosis = diagnose(recorded_brisk_moves(rig, 8), options);
  ASSERT_FALSE(diagnosis.causes.empty());
  EXPECT_EQ(diagnosis.causes.front().id, "backlash");
}

TEST(ControlFilter, ACauseBesideItIsNamed) {
  Rig rig = filtered();
  rig.body.cogging = 8.0;
  DiagnoseOptions options;
  options.identify.method = Method::kJoint;
  const Diagnosis diagnosis = diagnose(recorded_brisk_moves(rig, 8), options);
  ASSERT_EQ(diagnosis.causes.size(), 1U);
  EXPECT_EQ(diagnosis.causes.front().id, "cogging");
  EXPECT_NE(diagnosis.baseline.model.find(kind_of<ControlFilter>()), nullptr);
  EXPECT_LT(diagnosis.extended.holdout.rms, 0.2 * diagnosis.baseline.holdout.rms);
}

}  // namespace
}  // namespace servotwin::hidden_effects
