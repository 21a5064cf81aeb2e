#include "daemon/promotion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <sstream>

namespace servotwin {
namespace {

using testing::HasSubstr;

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr PromotionRule kRule{.judge_s = 4.0, .min_improvement = 0.02};

Candidacy good() {
  Candidacy candidacy;
  candidacy.rms = 1.5e-6;
  candidacy.rms_in_force = 2.0e-6;
  candidacy.version_in_force = 3;
  candidacy.judged_s = 4.2;
  return candidacy;
}

// Every combination of what may come in, against the rule said in another way.
TEST(Promotion, PromotesExactlyWhatIsUsableJudgedAndBetter) {
  int promoted = 0, all = 0;
  for (const bool invalid : {false, true}) {
    for (const int refusals : {0, 1, 2}) {
      for (const double judged_s : {0.0, 3.999, 4.0, 100.0, -1.0, kAbsent, kInfinity}) {
        for (const double rms :
             {kAbsent, kInfinity, -kInfinity, 0.0, 1e-9, 1.95e-6, 1.97e-6, 2e-6, 3e-6}) {
          for (const double rms_in_force : {kAbsent, kInfinity, 0.0, 2e-6}) {
            for (const int version : {0, 1, 7}) {
              Candidacy c;
              c.invalid = invalid ? "the loop is unstable" : "";
              for (int i = 0; i < refusals; ++i) c.refusals.push_back("mass is not excited");
              c.judged_s = judged_s;
              c.rms = rms;
              c.rms_in_force = rms_in_force;
              c.version_in_force = version;
              std::ostringstream what;
              what << invalid << ' ' << refusals << ' ' << judged_s << ' ' << rms << ' '
                   << rms_in_force << ' ' << version;
              SCOPED_TRACE(what.str());

              const bool usable = !invalid && refusals == 0;
              const bool judged = judged_s >= 4.0 && std::isfinite(rms);
              const bool better = !std::isfinite(rms_in_force) ||
                                  (rms < rms_in_force && rms <= 0.98 * rms_in_force);
              const Decision decision = decide(c, kRule);
              EXPECT_EQ(decision.promoted(), usable && judged && better);
              EXPECT_FALSE(decision.reason.empty());
              EXPECT_EQ(decision.reason.find('\n'), std::string::npos);
              promoted += decision.promoted() ? 1 : 0;
              ++all;
            }
          }
        }
      }
    }
  }
  EXPECT_GT(promoted, 0);
  EXPECT_LT(promoted, all);
}

TEST(Promotion, NamesTheFiguresItWasPromotedFor) {
  const Decision decision = decide(good(), kRule);
  EXPECT_EQ(decision.ruling, Ruling::kPromoted);
  EXPECT_EQ(decision.reason, "leaves 1.5 um RMS on 4.2 s of unseen motion, model 3 leaves 2 um");
}

TEST(Promotion, WithoutAModelInForceThereIsTheErrorItselfToBeat) {
  Candidacy candidacy = good();
  candidacy.version_in_force = 0;
  candidacy.rms_in_force = 600e-6;
  EXPECT_THAT(decide(candidacy, kRule).reason, HasSubstr("predicting nothing leaves 600 um"));
  candidacy.rms = 700e-6;
  EXPECT_EQ(decide(candidacy, kRule).ruling, Ruling::kNotBetter);
}

TEST(Promotion, ATieIsRefusedEvenWhereNoImprovementIsAskedFor) {
  Candidacy candidacy = good();
  candidacy.rms_in_force = candidacy.rms;
  EXPECT_EQ(decide(candidacy, {.judge_s = 4.0, .min_improvement = 0.0}).ruling, Ruling::kNotBetter);
}

TEST(Promotion, NearlyBetterIsRefusedWithTheShareThatIsMissing) {
  Candidacy candidacy = good();
  candidacy.rms = 1.97e-6;
  const Decision decision = decide(candidacy, kRule);
  EXPECT_EQ(decision.ruling, Ruling::kNotBetter);
  EXPECT_THAT(decision.reason, HasSubstr("must be better by 2 %"));
}

TEST(Promotion, SaysWhatTheIdentificationRefused) {
  Candidacy candidacy = good();
  candidacy.refusals = {"real pole is not excited", "Coulomb friction is not excited"};
  const Decision decision = decide(candidacy, kRule);
  EXPECT_EQ(decision.ruling, Ruling::kRefused);
  EXPECT_EQ(decision.reason, "real pole is not excited; Coulomb friction is not excited");
}

TEST(Promotion, SaysWhichBoundIsBroken) {
  Candidacy candidacy = good();
  candidacy.invalid = "the loop is unstable";
  const Decision decision = decide(candidacy, kRule);
  EXPECT_EQ(decision.ruling, Ruling::kInvalid);
  EXPECT_EQ(decision.reason, "the loop is unstable");
}

TEST(Promotion, RotaryAxesAreJudgedInMicroradians) {
  Candidacy candidacy = good();
  candidacy.rotary = true;
  EXPECT_THAT(decide(candidacy, kRule).reason, HasSubstr("1.5 urad"));
}

// The model in force left 1 um where it was judged itself.
TEST(Promotion, AModelHoldsWhereItLeavesNoMoreThanTwiceOfWhatItDid) {
  Candidacy c = good();
  EXPECT_TRUE(still_holds(c, 1.0e-6));
  EXPECT_FALSE(still_holds(c, 0.99e-6));
  EXPECT_FALSE(still_holds(c, kAbsent)) << "nobody knows what it left";
  c.rms_in_force = kAbsent;
  EXPECT_FALSE(still_holds(c, 1.0e-6)) << "nobody looked";
  c = good();
  c.version_in_force = 0;
  EXPECT_FALSE(still_holds(c, 1.0e-6)) << "there is none";
}

}  // namespace
}  // namespace servotwin
