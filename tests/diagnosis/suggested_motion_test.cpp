// The suggested test motion: for every pair of causes there is one, or a reason why not, and it
// stays within the limits of the recording.
#include "diagnosis/search/suggested_motion.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "diagnosis/search/diagnose.h"
#include "identification/recording/evidence.h"
#include "tests/virtual_machine/program.h"
#include "twin/catalogue.h"

namespace servotwin {
namespace {

namespace vm = virtual_machine;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;

constexpr double kMotionStep_s = 1e-3;

/// A recording of production-like moves that ends at rest.
std::vector<Segment> recorded(std::uint64_t seed) {
  vm::MoveMix mix;
  mix.duration = 12.0;
  const vm::Trajectory path = vm::moves(mix, seed);
  Segment s;
  s.sample_time_s = kMotionStep_s;
  s.command.resize(static_cast<Eigen::Index>(path.duration() / kMotionStep_s) + 1);
  for (Eigen::Index k = 0; k < s.size(); ++k)
    s.command(k) = path.at(static_cast<double>(k) * kMotionStep_s).position;
  return {s};
}

double largest_difference(const Eigen::ArrayXd& x, int order) {
  Eigen::ArrayXd d = x;
  for (int i = 0; i < order; ++i) {
    d = Eigen::ArrayXd((d.tail(d.size() - 1) - d.head(d.size() - 1)) / kMotionStep_s);
  }
  return d.abs().maxCoeff();
}

TEST(SeenMotion, IsNotMoreThanWasSeen) {
  const std::vector<Segment> segments = recorded(3);
  const Eigen::ArrayXd& x = segments.front().command;
  const SeenMotion seen = seen_motion(segments);
  EXPECT_EQ(seen.start, x(x.size() - 1));
  EXPECT_EQ(seen.low, x.minCoeff());
  EXPECT_EQ(seen.high, x.maxCoeff());
  EXPECT_LE(seen.velocity, largest_difference(x, 1) * (1 + 1e-9));
  EXPECT_LE(seen.acceleration, largest_difference(x, 2) * (1 + 1e-9));
  EXPECT_GT(seen.velocity, 0.9 * largest_difference(x, 1));
  EXPECT_GT(seen.acceleration, 0.7 * largest_difference(x, 2));
}

class EveryPair : public testing::TestWithParam<int> {};

TEST_P(EveryPair, HasAMotionWithinWhatWasSeenOrAReason) {
  const auto ids = contract_ids();
  const std::string_view first = ids[static_cast<std::size_t>(GetParam())];
  const std::vector<Segment> segments = recorded(4);
  const SeenMotion seen = seen_motion(segments);
  const Eigen::ArrayXd& was = segments.front().command;
  for (const std::string_view second : ids) {
    if (second == first) continue;
    SCOPED_TRACE(std::string(first) + " or " + std::string(second));
    const auto test = suggested_test({{std::string(first), std::string(second)}}, seen,
                                     {.period = 5e-3, .travel = 2e-5, .encoder_step = 1e-7});
    const auto other = suggested_test({{std::string(second), std::string(first)}}, seen, {});
    ASSERT_TRUE(test && other);
    EXPECT_EQ(test->motion.has_value(), other->motion.has_value());
    EXPECT_THAT(test->words, HasSubstr(std::string(first)));
    EXPECT_THAT(test->words, HasSubstr(std::string(second)));
    if (!test->motion) {
      EXPECT_THAT(test->words, HasSubstr("cannot be distinguished with these sensors: "));
      continue;
    }
    const Eigen::ArrayXd x = test->motion->command(kMotionStep_s);
    EXPECT_EQ(x(0), seen.start);
    EXPECT_NEAR(x(x.size() - 1), seen.start, 1e-12);
    EXPECT_GE(x.minCoeff(), seen.low - 1e-12);
    EXPECT_LE(x.maxCoeff(), seen.high + 1e-12);
    EXPECT_LE(largest_difference(x, 1), largest_difference(was, 1) * (1 + 1e-6));
    EXPECT_LE(largest_difference(x, 2), largest_difference(was, 2) * (1 + 1e-6));
    EXPECT_LT(test->motion->duration_s(), 240.0);
    const Eigen::Index tenth = 100;  // s * kMotionStep_s
    EXPECT_EQ(largest_difference(x.tail(tenth), 1), 0.0);
  }
}
INSTANTIATE_TEST_SUITE_P(Contract, EveryPair, testing::Range(0, 24));

TEST(SuggestedTest, KnowsEveryCauseOfTheCatalogueAndNoOther) {
  const auto ids = contract_ids();
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    if (!identity_of(kind).cause.empty()) {
      EXPECT_THAT(ids, Contains(identity_of(kind).cause));
    }
  }
  EXPECT_THROW((void)suggested_test({{"rust", "cogging"}}, seen_motion(recorded(1)), {}),
               std::invalid_argument);
}

TEST(SuggestedTest, OfNoDoubtIsNone) {
  EXPECT_FALSE(suggested_test({}, seen_motion(recorded(1)), {}).has_value());
}

TEST(SuggestedTest, AWeightAndUnlikeDirectionsAreOneClassOnOneAxis) {
  const SeenMotion seen = seen_motion(recorded(1));
  const auto alone = suggested_test({{"asymmetric_friction", "gravity_offset"}}, seen, {});
  EXPECT_FALSE(alone->motion.has_value());
  // Together with a pair that a motion decides, the motion is suggested and the reason is given.
  const auto both = suggested_test(
      {{"gravity_offset", "asymmetric_friction"}, {"cogging", "encoder_error"}}, seen, {});
  EXPECT_TRUE(both->motion.has_value());
  EXPECT_THAT(both->words,
              HasSubstr("gravity_offset and asymmetric_friction cannot be distinguished"));
}

TEST(SuggestedTest, RipplesAreRunAtTwoSpeedsOverSeveralPeriods) {
  const SeenMotion seen = seen_motion(recorded(2));
  const double period = (seen.high - seen.low) / 20.0;
  const auto test = suggested_test({{"cogging", "encoder_error"}}, seen, {.period = period});
  std::vector<double> speeds;
  for (const TestLeg& leg : test->motion->legs) {
    double from = test->motion->start;
    if (&leg != &test->motion->legs.front()) from = (&leg - 1)->to;
    if (std::abs(leg.to - from) > 7.9 * period) speeds.push_back(leg.velocity);
  }
  ASSERT_FALSE(speeds.empty());
  EXPECT_GT(*std::max_element(speeds.begin(), speeds.end()),
            4.0 * *std::min_element(speeds.begin(), speeds.end()));
  const auto too_short =
      suggested_test({{"cogging", "encoder_error"}}, seen, {.period = seen.high - seen.low});
  EXPECT_THAT(too_short->words, HasSubstr("covers 1.0 periods"));
}

TEST(SuggestedTest, OfADiagnosisAsksAboutItsRivalsAtTheirSizes) {
  SegmentedAxis axis;
  axis.segments = recorded(2);
  axis.segments.front().actual = axis.segments.front().command;
  Diagnosis diagnosis;
  EXPECT_FALSE(suggested_test(diagnosis, axis).has_value());
  Effect ripple = make_effect<Cogging>();
  ripple.shape[0] = 3e-3;
  diagnosis.extended.model.effects = {ripple};
  Cause cause;
  cause.id = "cogging";
  cause.confidence = 1.0;
  diagnosis.causes = {cause};
  EXPECT_FALSE(suggested_test(diagnosis, axis).has_value());
  diagnosis.causes[0].ambiguous_with = {"encoder_error"};
  const auto test = suggested_test(diagnosis, axis);
  ASSERT_TRUE(test && test->motion);
  EXPECT_THAT(test->words, HasSubstr("encoder_error"));
  double longest = 0.0;  // stroke at the speeds of the test
  for (std::size_t i = 1; i + 1 < test->motion->legs.size(); ++i)
    longest = std::max(longest, std::abs(test->motion->legs[i].to - test->motion->legs[i - 1].to));
  EXPECT_NEAR(longest, 8.0 * 3e-3, 1e-9);
  diagnosis.causes[0].ambiguous_with.clear();
  diagnosis.causes[0].confidence = 0.5;  // low confidence and no rival
  EXPECT_TRUE(suggested_test(diagnosis, axis)->motion.has_value());
  diagnosis.causes.clear();
  diagnosis.verdict = Verdict::kUnexplained;
  EXPECT_THAT(suggested_test(diagnosis, axis)->words, HasSubstr("everything that an error"));
}

TEST(SuggestedTest, AStandingAxisGetsWordsAndNoMotion) {
  Segment s;
  s.sample_time_s = kMotionStep_s;
  s.command = Eigen::ArrayXd::Constant(2000, 0.1);
  const auto test = suggested_test({{"cogging", "encoder_error"}}, seen_motion({s}), {});
  EXPECT_FALSE(test->motion.has_value());
  EXPECT_THAT(test->words, HasSubstr("contains no motion that a test could stay within"));
}

// A motor that turned at one speed for a few seconds: its command shows no acceleration.
TEST(SuggestedTest, AtOneSpeedItReachesThatSpeedWithinASecond) {
  SeenMotion turned;
  turned.sample_time_s = kMotionStep_s;
  turned.low = 0.0, turned.high = 6.0, turned.start = 6.0;
  turned.velocity = 0.6, turned.acceleration = 1e-4;
  const auto test = suggested_test({{"", ""}}, turned, {});
  ASSERT_TRUE(test && test->motion);
  EXPECT_LT(test->motion->duration_s(), 300.0);  // an hour by the acceleration that was seen
  EXPECT_NE(test->words.find("the recording hardly accelerates"), std::string::npos);
  EXPECT_NE(gcode(*test->motion, "C", false).find("within the recorded travel and speed"),
            std::string::npos);
  const Eigen::ArrayXd command = test->motion->command(0.01);
  const Eigen::Index n = command.size() - 1;
  EXPECT_LE((command.tail(n) - command.head(n)).abs().maxCoeff() / 0.01, 0.6);

  // A heavy gantry that needs 2 s is not asked for more.
  turned.acceleration = 0.3;
  const auto gentle = suggested_test({{"", ""}}, turned, {});
  EXPECT_FALSE(gentle->motion->accelerates_more);
  for (const TestLeg& leg : gentle->motion->legs) EXPECT_LE(leg.acceleration, 0.3);
}

TEST(TestMotion, ALegTakesTheTimeOfItsTrapezoid) {
  // 0.1 m at 0.05 m/s under 0.5 m/s^2: 2 s and a ramp of 0.1 s more.
  const TestMotion motion{0.2, 0.02, {{0.3, 0.05, 0.5, 0.4}}};
  EXPECT_NEAR(motion.duration_s(), 0.02 + 2.1 + 0.4, 1e-12);
  const Eigen::ArrayXd x = motion.command(kMotionStep_s);
  EXPECT_NEAR(x(1050), 0.25 - 0.01 * 0.05 + 0.5 * kMotionStep_s * 0.05,
              1e-6);  // half of the mean late
  EXPECT_NEAR(x(x.size() - 1), 0.3, 1e-12);
}

TEST(TestMotion, TooShortForItsSpeedItTurnsAtThePeakOfATriangle) {
  const TestMotion motion{0.0, 0.0, {{-0.01, 1.0, 1.0, 0.0}}};
  EXPECT_NEAR(motion.duration_s(), 0.2, 1e-12);
  EXPECT_NEAR(motion.command(kMotionStep_s)(100), -0.005, 1e-12);
}

TEST(TestMotion, GCodeSaysTheSameLegs) {
  TestMotion motion{0.1, 0.02, {{0.15, 0.05, 0.5, 0.4, "slow"}, {0.15, 0.05, 0.5, 2.0}}};
  const std::string linear = gcode(motion, "X", false);
  EXPECT_THAT(linear, HasSubstr("G90 G94 G21\n(slow)\n"));
  EXPECT_THAT(linear, HasSubstr("G1 X150.00000 F3000.0000\nG4 P0.400\nG4 P2.000\nM30\n"));
  motion.legs.front().to = std::numbers::pi / 2;
  const std::string rotary = gcode(motion, "C1", true);
  EXPECT_THAT(rotary, HasSubstr("G1 C1=90.00000 F171.88"));
  EXPECT_THAT(rotary, Not(HasSubstr("G21")));
}

}  // namespace
}  // namespace servotwin
