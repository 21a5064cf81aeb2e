// The gap that the recorded motion shows, of machines that share no code with the twin.
#include "identification/loop/gap_scan.h"

#include <gtest/gtest.h>

#include "identification/loop/identify.h"
#include "identification/recording/noise_floor.h"
#include "tests/hidden_effects/brisk_moves.h"

namespace servotwin::hidden_effects {
namespace {

/// 300 kg, of which 180 kg lie behind a stiff contact and slide easily: 15 N.
Rig easy_slide(double gap) {
  Rig rig;
  rig.body.mass = 300.0;
  rig.body.motor_share = 0.4;
  rig.body.spring_frequency_hz = 400.0;
  rig.body.damping_ratio = 0.1;
  rig.body.gap = gap;
  rig.friction.level = 15.0;
  rig.friction.saturation_velocity = 1e-3;
  rig.drive.position_gain = 120.0;
  rig.drive.velocity_gain = 300.0 * 800.0;
  rig.reading.noise = 2e-8;
  rig.reading.sample_time = 2e-3;
  return rig;
}

std::optional<GapFound> found_in(const SegmentedAxis& axis) {
  IdentifyOptions options;
  options.must_predict = false;
  const Model rigid = identify(axis, options).record.model;
  Structure structure;
  structure.order = rigid.loop.order;
  for (const Effect& effect : rigid.effects) structure.effects.push_back(effect.kind);
  return scan_gap(axis.segments, structure, rigid, noise_floor(axis.segments).encoder_step);
}

class AGap : public testing::TestWithParam<double> {};

TEST_P(AGap, IsFoundByWhenTheLoadHitsItsOtherSide) {
  const auto found = found_in(recorded_brisk_moves(easy_slide(GetParam()), 6));
  ASSERT_TRUE(found);
  // A wider gap with a load that brakes as much more is hit at nearly the same moments: half a step
  // of the grid in both, the square root of 1.25 * 1.6.
  EXPECT_NEAR(found->width, GetParam(), 0.415 * GetParam());
  EXPECT_GT(found->explained, 0.9);
}
INSTANTIATE_TEST_SUITE_P(Dev, AGap, testing::Values(30e-6, 60e-6, 120e-6));

TEST(GapScan, FindsNothingToExplainInNoise) {
  Rig rig = easy_slide(0.0);
  rig.body.spring_frequency_hz = 0.0;  // the rigid axis that the model is
  EXPECT_FALSE(found_in(recorded_brisk_moves(rig, 6)));
}

}  // namespace
}  // namespace servotwin::hidden_effects
