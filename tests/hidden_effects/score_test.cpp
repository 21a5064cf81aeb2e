// The counting of answers.
#include "tests/hidden_effects/score.h"

#include <gmock/gmock.h>

#include <cmath>
#include <sstream>

namespace servotwin::hidden_effects {
namespace {

using testing::ElementsAre;
using testing::Field;
using testing::HasSubstr;

TEST(Score, UpperBoundIsClopperAndPearsons) {
  // None of n: 1 - 0.05^(1/n). The second is tabulated (2 of 50: 0.1206).
  EXPECT_NEAR(upper_bound(0, 300), 1.0 - std::pow(0.05, 1.0 / 300.0), 1e-9);
  EXPECT_NEAR(upper_bound(2, 50), 0.1206, 1e-4);
  EXPECT_EQ(upper_bound(5, 5), 1.0);
}

Outcome of(const std::vector<std::string>& own, const std::vector<std::string>& named) {
  Outcome out;
  out.kind = Kind::kSingle;
  out.made.name = "dev/backlash/0";
  out.made.own = own;
  out.made.hidden.resize(1);
  out.made.hidden.front().id = "backlash";
  out.made.noise_rms = 1e-7;
  for (const std::string& id : named) {
    NamedCause& cause = out.answer.causes.emplace_back();
    cause.id = id;
    cause.confidence = 0.9;
  }
  out.answer.verdict = named.empty() ? "nothing_significant" : "explained";
  return out;
}

TEST(Score, TheMachinesOwnNatureDoesNotCount) {
  const Outcome outcome = of({"presliding"}, {"presliding", "backlash", "cogging"});
  EXPECT_EQ(outcome.first(), "backlash");
  EXPECT_THAT(outcome.named(),
              ElementsAre(Field(&NamedCause::id, "backlash"), Field(&NamedCause::id, "cogging")));
  EXPECT_EQ(of({"presliding"}, {"presliding"}).first(), "none");
  EXPECT_EQ(of({}, {"presliding"}).first(), "presliding");
}

TEST(Score, AFailureIsNoAnswer) {
  Outcome outcome = of({}, {});
  EXPECT_EQ(outcome.first(), "none");
  outcome.answer.verdict = "unexplained";
  EXPECT_EQ(outcome.first(), "unexplained");
  outcome.answer.failure = "the data are too short";
  EXPECT_EQ(outcome.first(), "failed");
}

TEST(Score, PrintsWhatWasCounted) {
  Outcome clean = of({}, {"cogging"});
  clean.kind = Kind::kClean;
  clean.made.hidden.clear();
  std::ostringstream out;
  print_scores(
      {of({}, {"backlash"}), of({}, {"compliance"}), of({}, {}), of({}, {"backlash"}), clean}, {},
      out);
  EXPECT_THAT(out.str(), HasSubstr("named first    2 of 4 (50.0 %)"));
  EXPECT_THAT(out.str(), HasSubstr("false alarms         1 of 1 (100.0 %)"));
  EXPECT_THAT(out.str(), HasSubstr("backlash 2, compliance 1, none 1,"));
  // Four causes named with 0.9, two of them right.
  EXPECT_THAT(out.str(), HasSubstr("0.90   2 of 4 (50.0 %)"));
  EXPECT_THAT(out.str(), HasSubstr("calibration error         0.400"));
}

}  // namespace
}  // namespace servotwin::hidden_effects
