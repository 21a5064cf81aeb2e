#include "daemon/identify/promotion.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <sstream>

namespace servotwin::daemon {
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

// All combinations of inputs, against an independent formulation of the rule.
TEST(Promotion, PromotesExactlyWhatIsUsableJudgedAndBetter) {
  int promoted = 0, all = 0;
  for (const bool invalid : {false, true}) {
    for (const int refusals : {0, 1, 2}) {
      for (const double judged_s : {0.0, 3.999, 4.0, 100.0, -1.0, kAbsent, kInfinity}) {
        for (const double rms : {kAbsent, kInfinity, -kInfinity, 0.0, 1e-9, 1.79e-6, 1.81e-6,
                                 1.95e-6, 1.97e-6, 2e-6, 3e-6}) {
          for (const double rms_in_force : {kAbsent, kInfinity, 0.0, 2e-6}) {
            for (const int version : {0, 1, 7}) {
              for (const double sure : {kAbsent, -3.0, 1.74, 1.75, 2.99, 3.0, kInfinity}) {
                Candidacy c;
                c.significance = sure;
                c.invalid = invalid ? "the loop is unstable" : "";
                for (int i = 0; i < refusals; ++i) c.refusals.push_back("mass is not excited");
                c.judged_s = judged_s;
                c.rms = rms;
                c.rms_in_force = rms_in_force;
                c.version_in_force = version;
                std::ostringstream what;
                what << invalid << ' ' << refusals << ' ' << judged_s << ' ' << rms << ' '
                     << rms_in_force << ' ' << version << ' ' << sure;
                SCOPED_TRACE(what.str());

                const bool usable = !invalid && refusals == 0;
                const bool judged = judged_s >= 4.0 && std::isfinite(rms);
                const bool believed = version == 0 || rms <= 0.8 * rms_in_force ||
                                      sure >= (rms <= 0.9 * rms_in_force ? 1.75 : 3.0);
                const bool better = !std::isfinite(rms_in_force) ||
                                    (rms < rms_in_force && rms <= 0.98 * rms_in_force && believed);
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
  }
  EXPECT_GT(promoted, 0);
  EXPECT_LT(promoted, all);
}

TEST(Promotion, NamesTheFiguresItWasPromotedFor) {
  const Decision decision = decide(good(), kRule);
  EXPECT_EQ(decision.ruling, Ruling::kPromoted);
  EXPECT_EQ(decision.reason, "residual 1.5 um RMS on 4.2 s of held-out motion, with model 3 2 um");
}

TEST(Promotion, WithoutAModelInForceThereIsTheErrorItselfToBeat) {
  Candidacy candidacy = good();
  candidacy.version_in_force = 0;
  candidacy.rms_in_force = 600e-6;
  EXPECT_THAT(decide(candidacy, kRule).reason, HasSubstr("without a model 600 um"));
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

TEST(Promotion, ALittleBetterMustBeBetterOnMostOfTheMotion) {
  Candidacy candidacy = good();
  candidacy.rms = 1.9e-6;
  candidacy.significance = 1.3;
  const Decision decision = decide(candidacy, kRule);
  EXPECT_EQ(decision.ruling, Ruling::kByChance);
  EXPECT_EQ(decision.reason,
            "residual 1.9 um RMS on 4.2 s of held-out motion, with model 3 2 um; better by 1.3 "
            "standard errors, not significant (needs 3, or an RMS lower by 20 %)");
  candidacy.significance = 3.1;
  EXPECT_EQ(decide(candidacy, kRule).ruling, Ruling::kPromoted);
  candidacy.significance = 1.8;
  EXPECT_EQ(decide(candidacy, kRule).ruling, Ruling::kByChance);
  candidacy.rms = 1.75e-6;
  EXPECT_EQ(decide(candidacy, kRule).ruling, Ruling::kPromoted);
}

// Sixteen blocks of two samples: the squares differ by 1 and 3 in turn, so the mean is 2, the
// standard deviation sqrt(16/15), and that of the mean a quarter of it. Two further samples fill no
// block and are left out.
TEST(Promotion, SurenessIsTheMeanAdvantageByItsStandardError) {
  Eigen::ArrayXd left = Eigen::ArrayXd::Zero(34), other(34);
  for (Eigen::Index k = 0; k < 34; ++k) other[k] = std::sqrt(k / 2 % 2 == 0 ? 1.0 : 3.0);
  other[32] = other[33] = 1000.0;
  EXPECT_NEAR(significance(left, other), 2.0 / (0.25 * std::sqrt(16.0 / 15.0)), 1e-12);
  EXPECT_NEAR(significance(other, left), -2.0 / (0.25 * std::sqrt(16.0 / 15.0)), 1e-12);
  EXPECT_TRUE(std::isnan(significance(left, left))) << "no part differs from another";
  EXPECT_TRUE(std::isnan(significance(left.head(15), other.head(15)))) << "too short";
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

// The model in force had a residual of 1 um on its held-out data.
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
}  // namespace servotwin::daemon
