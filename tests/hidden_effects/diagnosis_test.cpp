// The diagnosis of a few of the cases: the fast part of the benchmark. The hit rate over all cases
// is measured by the program hidden_effects, not asserted here.
#include <gmock/gmock.h>

#include <algorithm>

#include "tests/hidden_effects/answer.h"
#include "tests/hidden_effects/cases.h"

namespace servotwin::hidden_effects {
namespace {

/// The named causes without the machine's own friction, in order.
std::vector<std::string> named(const Answer& answer, const Case& asked) {
  std::vector<std::string> out;
  for (const NamedCause& cause : answer.causes) {
    if (!asked.owns(cause.id) || asked.hides(cause.id)) out.push_back(cause.id);
  }
  return out;
}

class AHiddenEffect : public testing::TestWithParam<const char*> {};

TEST_P(AHiddenEffect, IsNamedFirst) {
  const Case asked = single_case(Part::kDev, GetParam(), Class::kClear, 0);
  const Answer answer = ask(asked.csv, {});
  ASSERT_EQ(answer.failure, "");
  // The impulses in the held-out data cannot be predicted: the verdict may be "unexplained"
  // although the cause is named.
  if (GetParam() != std::string("impulse_disturbance")) {
    EXPECT_EQ(answer.verdict, "explained");
  }
  ASSERT_FALSE(named(answer, asked).empty());
  EXPECT_EQ(named(answer, asked).front(), GetParam());
}
// The motor reaches its limit only in the last seconds: divided by time alone, the training data
// would not contain it.
TEST(LongAMotorAtItsLimit, IsNamedWhereAllOfItIsLateInTheRecording) {
  const Case asked = single_case(Part::kDev, "torque_saturation", Class::kClear, 1);
  const Answer answer = ask(asked.csv, {});
  ASSERT_EQ(answer.failure, "");
  EXPECT_EQ(answer.verdict, "explained");
  ASSERT_FALSE(named(answer, asked).empty());
  EXPECT_EQ(named(answer, asked).front(), "torque_saturation");
  EXPECT_LT(answer.after_rms, 0.1 * answer.before_rms);
}

// Case 81: the residual of motion cut out of a recording with saturation is no evidence; it had led
// to friction and backlash being named first. Case 63: the held-out data begin within a motion,
// while the integrator is held.
class AMotorsLimit : public testing::TestWithParam<int> {};

TEST_P(AMotorsLimit, IsAllThatIsNamedAndLeavesTheNoise) {
  const Case asked = single_case(Part::kDev, "torque_saturation", Class::kClear, GetParam());
  const Answer answer = ask(asked.csv, {});
  ASSERT_EQ(answer.failure, "");
  EXPECT_EQ(answer.verdict, "explained");
  EXPECT_THAT(named(answer, asked), testing::ElementsAre("torque_saturation"));
  EXPECT_LT(answer.after_rms, 1.2 * asked.noise_rms);
}
INSTANTIATE_TEST_SUITE_P(LongDev, AMotorsLimit, testing::Values(63, 81));

INSTANTIATE_TEST_SUITE_P(Dev, AHiddenEffect, testing::Values("asymmetric_friction", "stribeck"),
                         [](const auto& test) { return std::string(test.param); });
INSTANTIATE_TEST_SUITE_P(LongDev, AHiddenEffect,
                         testing::Values("cogging", "cross_coupling", "encoder_error",
                                         "gain_change", "impulse_disturbance", "lead_error",
                                         "periodic_disturbance", "position_dependent_friction",
                                         "presliding", "thermal_growth", "time_delay",
                                         "viscous_drift"),
                         [](const auto& test) { return std::string(test.param); });

// From 50 times the noise on, the loop that is fitted to all motion is a compromise between two
// machines: friction, a delay and impulses had been named for this gain.
TEST(LongALargeChange, OfTheGainIsFoundByTheLoopOfWhatWasBefore) {
  const Case asked = single_case(Part::kDev, "gain_change", Class::kLarge, 300);
  const Answer answer = ask(asked.csv, {});
  ASSERT_EQ(answer.failure, "");
  EXPECT_EQ(answer.verdict, "explained");
  ASSERT_THAT(named(answer, asked), testing::ElementsAre("gain_change"));
  for (const char* key : {"ratio", "time_s"})
    EXPECT_NEAR(answer.causes.front().parameters.at(key) / asked.hidden.front().parameters.at(key),
                1.0, 0.02)
        << key;
}

// A load on a spring with its friction on it: none of these was explained by a twin of one mass.
class ALoadOnASpring : public testing::TestWithParam<int> {};

TEST_P(ALoadOnASpring, IsNamedFirstWithItsFrequency) {
  const Case asked = single_case(Part::kDev, "compliance", Class::kClear, GetParam());
  const Answer answer = ask(asked.csv, {});
  ASSERT_EQ(answer.failure, "");
  ASSERT_FALSE(named(answer, asked).empty());
  EXPECT_EQ(named(answer, asked).front(), "compliance");
  const auto found = std::find_if(answer.causes.begin(), answer.causes.end(),
                                  [](const NamedCause& one) { return one.id == "compliance"; });
  ASSERT_NE(found, answer.causes.end());
  EXPECT_NEAR(
      found->parameters.at("frequency_hz") / asked.hidden.front().parameters.at("frequency_hz"),
      1.0, 0.02);
}
// 3001: no integrator, but a rigid loop needs one to imitate the spring. 3003: a mode beside a
// rigid axis was enough. 51: beside a rigid axis it was a mode damped like a filter.
// 350, 355: a filter of the control stood for it, at 350 with a delay of 5 ms. 366: the loop and a
// mode had changed places.
INSTANTIATE_TEST_SUITE_P(LongDev, ALoadOnASpring,
                         testing::Values(43, 44, 46, 51, 350, 355, 366, 3001, 3003));
// A filter of the control left 1.1 times the noise floor.
INSTANTIATE_TEST_SUITE_P(Dev, ALoadOnASpring, testing::Values(354));

// Zeros in the right half plane follow it better than the delay that was named in its place.
TEST(ALoadOnAStiffSpring, IsNoDelay) {
  const Case asked = single_case(Part::kDev, "compliance", Class::kClear, 280);
  const Answer answer = ask(asked.csv, {});
  ASSERT_EQ(answer.failure, "");
  EXPECT_THAT(named(answer, asked), testing::Not(testing::Contains("time_delay")));
  EXPECT_LT(answer.after_rms, 0.05 * answer.before_rms);
}

class AnEffectThatAnotherStoodFor : public testing::TestWithParam<std::pair<const char*, int>> {};

TEST_P(AnEffectThatAnotherStoodFor, IsNamedAloneAndLeavesLittle) {
  const auto [id, index] = GetParam();
  const Case asked = single_case(Part::kDev, id, Class::kClear, index);
  const Answer answer = ask(asked.csv, {});
  ASSERT_EQ(answer.failure, "");
  EXPECT_THAT(named(answer, asked), testing::ElementsAre(id));
  EXPECT_LT(answer.after_rms, 0.2 * answer.before_rms);
}
// Pushes at free moments stood for a limit, friction that falls at once for one that grows at rest,
// the creep of an axis at rest for noise, and the misfit of a law of friction for all that is left.
INSTANTIATE_TEST_SUITE_P(
    LongDev, AnEffectThatAnotherStoodFor,
    testing::Values(std::pair("torque_saturation", 230), std::pair("torque_saturation", 3002),
                    std::pair("torque_saturation", 3003), std::pair("dwell_stiction", 3000),
                    std::pair("compliance", 3002), std::pair("compliance", 361),
                    std::pair("dwell_stiction", 353)),
    [](const auto& test) {
      return std::string(test.param.first) + '_' + std::to_string(test.param.second);
    });

// With the law of friction that was chosen before the delay was known 2.9 times the noise is left.
TEST(LongALawOfFriction, IsChosenAgainBesideTheCauses) {
  const Case asked = single_case(Part::kDev, "time_delay", Class::kClear, 231);
  const Answer answer = ask(asked.csv, {});
  ASSERT_EQ(answer.failure, "");
  EXPECT_THAT(named(answer, asked), testing::ElementsAre("time_delay"));
  EXPECT_LT(answer.after_rms, 1.5 * asked.noise_rms);
}

class ACleanMachine : public testing::TestWithParam<int> {};

TEST_P(ACleanMachine, GetsNoCauseButItsOwnFriction) {
  const Case asked = clean_case(Part::kDev, GetParam());
  const Answer answer = ask(asked.csv, {});
  ASSERT_EQ(answer.failure, "");
  EXPECT_THAT(named(answer, asked), testing::IsEmpty());
}
INSTANTIATE_TEST_SUITE_P(Dev, ACleanMachine, testing::Values(0, 1, 3));
INSTANTIATE_TEST_SUITE_P(LongDev, ACleanMachine, testing::Values(2, 4));

// An effect left out of the catalogue is not named. An error of the screw and one of the encoder,
// of one period, do in its place what the ripple does: they are not called certain.
TEST(LongLeaveOut, WithoutCoggingWhatIsNamedInItsPlaceIsAmbiguous) {
  const Case asked = single_case(Part::kDev, "cogging", Class::kClear, 0);
  const Answer without = ask(asked.csv, {"cogging"});
  ASSERT_EQ(without.failure, "");
  for (const NamedCause& cause : without.causes) {
    EXPECT_NE(cause.id, "cogging");
    if (cause.id == "lead_error" || cause.id == "encoder_error") {
      EXPECT_FALSE(cause.ambiguous_with.empty()) << cause.id;
    }
  }
}

TEST(LongLeaveOut, ADelayThatIsLeftOutIsNotNamed) {
  const Case asked = single_case(Part::kDev, "time_delay", Class::kClear, 1);
  const Answer without = ask(asked.csv, {"time_delay"});
  ASSERT_EQ(without.failure, "");
  for (const NamedCause& cause : without.causes) EXPECT_NE(cause.id, "time_delay");
}

}  // namespace
}  // namespace servotwin::hidden_effects
