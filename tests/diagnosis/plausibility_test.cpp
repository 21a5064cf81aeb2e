// Models that no machine has, although each of their parameters is within its bounds.
#include "diagnosis/search/plausibility.h"

#include <gtest/gtest.h>

namespace servotwin {
namespace {

Model loop_with(const Effect& effect) {
  Model model;
  model.sample_time_s = 1e-3;
  model.loop.order = 3;
  model.loop.denominator = {300.0, 3e4, 1e6};
  model.effects = {effect};
  return model;
}

/// The effect with its gap so wide.
Effect with_gap(Effect effect, double width) {
  std::size_t i = 0;
  while (shapes_of(effect.kind)[i].name != "width") ++i;
  effect.shape[i] = width;
  effect.coefficient[1] = 0.5;  // of the part behind a gap: none would be no part
  return effect;
}

bool is_plausible(const Effect& effect, double encoder_step = 0.0) {
  return plausible(loop_with(effect), 0.0, 20.0, 0.1, encoder_step);
}

// A hidden friction that depends on position was called play, with a gap of 0.1 um: the least that
// a fit can give.
TEST(Plausible, AGapThatTheFitHasClosedIsNone) {
  for (const Effect& gap : {make_effect<Backlash>(), make_effect<BacklashBehindEncoder>()}) {
    EXPECT_FALSE(is_plausible(with_gap(gap, 1e-7))) << identity_of(gap.kind).id;
    EXPECT_TRUE(is_plausible(with_gap(gap, 1e-6))) << identity_of(gap.kind).id;
  }
}

// A healthy hidden machine was said to have 0.71 um of play between its encoders, by an encoder
// with steps of 0.735 um.
TEST(Plausible, AGapBelowOneStepOfTheEncoderIsNone) {
  const Effect gap = with_gap(make_effect<Backlash>(), 0.71e-6);
  EXPECT_FALSE(is_plausible(gap, 0.735e-6));
  EXPECT_TRUE(is_plausible(gap, 0.1e-6));
}

Effect spring(double frequency_hz, double damping) {
  Effect effect = make_effect<TwoMassLoadEncoder>();
  effect.shape[0] = frequency_hz;
  effect.shape[1] = damping;
  return effect;
}

// A healthy axis of a machining centre, recorded at 3 ms, was said to have a spring of 8.7 Hz whose
// damping the fit had removed; structures of machines have 1 to 10 %.
TEST(Plausible, ASlowSpringWithoutDampingOrOneHardlyRingingIsNone) {
  EXPECT_FALSE(is_plausible(spring(8.7, 0.002)));
  EXPECT_FALSE(is_plausible(spring(8.7, 0.3)));
  EXPECT_TRUE(is_plausible(spring(8.7, 0.01)));
  EXPECT_TRUE(is_plausible(spring(8.7, 0.1)));
}

// A hidden spring of 75 Hz and 1 % beside a loop of 18 Hz was fitted with 70 Hz and the least
// damping: the drive's lag, which is not in the model, feeds it. The poles here are at 15.9 Hz.
TEST(Plausible, AFastSpringMayHaveLostItsDampingToTheDrive) {
  EXPECT_FALSE(is_plausible(spring(45.0, 0.002)));
  EXPECT_TRUE(is_plausible(spring(50.0, 0.002)));
}

// The same healthy axis: 9.4 Hz with a reset rate of 1000 1/s, its limit. Here a2 / a1 is 100 1/s.
TEST(Plausible, ADriveWithoutPositionGainIsNone) {
  Effect effect = spring(8.7, 0.05);
  effect.shape[TwoMassLoadEncoder::kResetAt] = 1000.0;
  EXPECT_FALSE(is_plausible(effect));
  effect.shape[TwoMassLoadEncoder::kResetAt] = 99.0;
  EXPECT_TRUE(is_plausible(effect));
}

TEST(Plausible, ASpringTooFastForTheSamplesIsNone) {
  Effect fast = make_effect<TwoMassLoadEncoder>();
  fast.shape[1] = 0.05;
  fast.shape[0] = 450.0;  // Hz, at 1 kHz
  EXPECT_FALSE(is_plausible(fast));
  fast.shape[0] = 200.0;
  EXPECT_TRUE(is_plausible(fast));
}

// An axis in degrees with presliding and nothing else was said to have a spring of 271 Hz that
// carries two per cent of its inertia.
TEST(Plausible, ASpringWithHardlyAnyMassOnOneSideIsNone) {
  Effect effect = spring(200.0, 0.05);
  for (const double share : {0.02, 0.98}) {
    effect.shape[2] = share;
    EXPECT_FALSE(is_plausible(effect)) << share;
  }
  effect.shape[2] = 0.1;
  EXPECT_TRUE(is_plausible(effect));
}

// Another recording of the same axis: a gap of 5 urad, with a contact of 264 Hz, a damping of 0.68
// and two per cent of the inertia behind it.
TEST(Plausible, NorIsAGap) {
  Effect effect = make_effect<PlayLoadEncoder>();
  effect.shape[0] = 264.0;
  effect.shape[1] = 0.68;
  effect.shape[2] = 0.02;
  EXPECT_FALSE(is_plausible(effect));
  effect.shape[2] = 0.1;
  EXPECT_TRUE(is_plausible(effect));
}

TEST(Plausible, AnEffectWithoutAGapHasNoneToClose) {
  Effect effect = make_effect<Presliding>();
  effect.coefficient[0] = 0.3;
  EXPECT_TRUE(is_plausible(effect));
}

// A healthy machine was told of dwell stiction at 96 %, with a growth of 0.
TEST(Plausible, ACauseWithoutForceIsNone) {
  Effect effect = make_effect<DwellStiction>();
  EXPECT_FALSE(is_plausible(effect));
  effect.coefficient[0] = 0.02;
  EXPECT_TRUE(is_plausible(effect));
  // Part of every machine: friction of an ideal axis is 0, and no cause.
  EXPECT_TRUE(is_plausible(make_effect<CoulombFriction>()));
}

}  // namespace
}  // namespace servotwin
