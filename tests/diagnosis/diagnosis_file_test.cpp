#include "diagnosis/report/diagnosis_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "diagnosis/report/cause_words.h"
#include "diagnosis/report/torque_text.h"

namespace servotwin {
namespace {

using testing::HasSubstr;
using testing::Not;

/// A diagnosis with torque saturation and a loop of this order.
Diagnosis saturated(int order) {
  Diagnosis diagnosis;
  diagnosis.extended.model.loop.order = order;
  diagnosis.extended.model.effects = {make_effect<TorqueSaturation>()};
  diagnosis.extended.model.effects[0].shape[1] = 77.0;
  Cause cause;
  cause.id = "torque_saturation";
  diagnosis.causes = {cause};
  return diagnosis;
}

TEST(DiagnosisFile, WithoutAnIntegratorNothingIsSaidOfItsReset) {
  const Diagnosis with = saturated(3), without = saturated(2);
  EXPECT_THAT(cause_text(with, with.causes[0]), HasSubstr("reset 77 1/s"));
  EXPECT_THAT(cause_text(without, without.causes[0]), Not(HasSubstr("reset")));
  EXPECT_THAT(cause_text(without, without.causes[0]), HasSubstr("limit_mps2"));
  EXPECT_EQ(to_json(with, "")["causes"][0]["parameters"]["reset"], 77.0);
  const nlohmann::json parameters = to_json(without, "")["causes"][0]["parameters"];
  ASSERT_TRUE(parameters.contains("reset")) << "the key is always present";
  EXPECT_TRUE(parameters["reset"].is_null());
}

TEST(DiagnosisFile, NamesThePageOfEveryCause) {
  EXPECT_EQ(to_json(saturated(2), "")["causes"][0]["page"], "docs/causes/torque_saturation.md");
}

TEST(Advice, FrictionThatRisesWithSpeedIsNoMatterOfLubrication) {
  Diagnosis diagnosis;
  Cause cause;
  cause.id = "stribeck";
  const auto advice = [&](const Effect& effect) {
    diagnosis.extended.model.effects = {effect};
    return advice_for(diagnosis, cause);
  };
  Effect falling = make_effect<FallingFriction>(), law = make_effect<LuGre>();
  double* ratio = nullptr;
  for (std::size_t i = 0; i < shapes_of(law.kind).size(); ++i) {
    if (shapes_of(law.kind)[i].name == "breakaway_ratio") ratio = &law.shape[i];
  }
  ASSERT_NE(ratio, nullptr);
  falling.coefficient[0] = 0.1;
  *ratio = 1.3;
  EXPECT_THAT(advice(falling), HasSubstr("lubrication"));
  EXPECT_THAT(advice(law), HasSubstr("lubrication"));
  falling.coefficient[0] = -0.1;
  *ratio = 0.7;
  EXPECT_THAT(advice(falling), Not(HasSubstr("lubrication")));
  EXPECT_THAT(advice(law), HasSubstr("wipers"));
  EXPECT_EQ(to_json(saturated(2), "")["causes"][0]["check"], advice_for("torque_saturation"));
}

TEST(Advice, IsThatOfTheEffectWhichStandsForTheCause) {
  Diagnosis diagnosis;
  Cause cause;
  const auto advice = [&](const char* id, const Effect& effect) {
    cause.id = id;
    diagnosis.extended.model.effects = {effect};
    return advice_for(diagnosis, cause);
  };
  EXPECT_THAT(advice("compliance", make_effect<Compliance>()), HasSubstr("foundation"));
  EXPECT_THAT(advice("compliance", make_effect<TwoMassOutside>()), HasSubstr("stiffness of"));
  EXPECT_THAT(advice("gravity_offset", make_effect<SwingingLoad>()),
              HasSubstr("weight of the load"));
  EXPECT_THAT(advice("backlash", make_effect<BacklashBehindEncoder>()),
              HasSubstr("behind the encoder"));
  // A law that is no cause by itself has none.
  EXPECT_EQ(advice("presliding", make_effect<Gms>()), advice_for("presliding"));
}

TEST(VerdictText, DoesNotPraiseCausesThatChangeNothing) {
  Diagnosis diagnosis;
  diagnosis.verdict = Verdict::kExplained;
  diagnosis.causes.resize(2);
  diagnosis.baseline.noise_floor.rms = 1.3e-7;
  diagnosis.baseline.holdout.rms = diagnosis.extended.holdout.rms = 7.33e-7;
  EXPECT_EQ(
      verdict_text(diagnosis),
      "2 causes named, part of the identified model or repaired in the recording already: the "
      "simulation error on held-out data is 0.733 um RMS with them (noise floor 0.13)");
  diagnosis.extended.holdout.rms = 3e-7;
  EXPECT_EQ(verdict_text(diagnosis),
            "2 causes named: the simulation error on held-out data is 0.3 um RMS instead of 0.733 "
            "(noise floor 0.13)");
}

TEST(VerdictText, WhatWasCountedExplainsNothing) {
  Diagnosis diagnosis;
  diagnosis.baseline.axis = "X";
  diagnosis.verdict = Verdict::kUnexplained;
  diagnosis.causes.resize(1);
  diagnosis.causes[0].id = "dropped_samples";
  diagnosis.causes[0].place = kNoEffect;
  EXPECT_THAT(verdict_text(diagnosis), HasSubstr("no cause in the catalogue explains it"));
  EXPECT_THAT(plain_verdict(diagnosis), HasSubstr("none of the known causes explains"));
  diagnosis.extended.model.effects.push_back(make_effect<SwingingLoad>());
  diagnosis.causes.resize(2);
  diagnosis.causes[1].id = "gravity_offset";
  diagnosis.causes[1].place = 0;
  EXPECT_THAT(verdict_text(diagnosis), HasSubstr("unexplained: 1 cause named"));
  EXPECT_THAT(plain_verdict(diagnosis),
              HasSubstr("explained only in part, by the weight of a load that swings with it"));
}

TEST(Verdict, BeginsWithTheLimitOfTheMotor) {
  Diagnosis diagnosis;
  diagnosis.baseline.axis = "X";
  EXPECT_THAT(verdict_text(diagnosis), testing::StartsWith("nothing significant"));
  EXPECT_THAT(plain_verdict(diagnosis), testing::StartsWith("Axis X agrees with"));
  diagnosis.at_limit = "190 N in 6 moments (0.3 s in all)";
  EXPECT_THAT(verdict_text(diagnosis),
              testing::StartsWith("the motor is at its torque limit. nothing significant"));
  EXPECT_THAT(plain_verdict(diagnosis), testing::HasSubstr(". The axis agrees with"));
  diagnosis.limit_left_out = true;
  EXPECT_THAT(
      verdict_text(diagnosis),
      testing::StartsWith("the motor is at its torque limit. Away from it nothing significant"));
  const std::string plain = plain_verdict(diagnosis);
  EXPECT_THAT(plain, testing::StartsWith("Axis X asks its motor for more than it can give: the "
                                         "motor stays at 190 N in 6 moments"));
  EXPECT_THAT(plain, testing::HasSubstr(". Away from these moments the axis agrees with"));
}

TEST(Verdict, NamesWhatOnlyTheTorqueShows) {
  Diagnosis diagnosis;
  diagnosis.baseline.axis = "X";
  const auto by = [](const char* id) {
    TorqueCause cause;
    cause.id = id;
    return cause;
  };
  EXPECT_THAT(plain_verdict(diagnosis), testing::HasSubstr("no cause needs to be looked for"));
  const std::string plain =
      plain_verdict(diagnosis, {as_shown(by("cogging")), as_shown(by("backlash"))});
  EXPECT_THAT(plain, testing::StartsWith("Axis X agrees with its simulation"));
  EXPECT_THAT(plain, testing::HasSubstr(" The torque shows a force ripple that repeats along the "
                                        "axis; play (backlash). Check first: what repeats"));
  EXPECT_THAT(plain, testing::Not(testing::HasSubstr("no cause")));
  diagnosis.verdict = Verdict::kUnexplained;
  EXPECT_THAT(plain_verdict(diagnosis, {as_shown(by("cogging"))}),
              testing::HasSubstr(" The torque shows"));
  TorqueCause rising = by("stribeck");
  rising.parameters = {{"drop_nm", -0.2}};
  const std::string of_rising = plain_verdict(diagnosis, {as_shown(rising)});
  EXPECT_THAT(
      of_rising,
      HasSubstr("friction that is lower at creeping speed than at feed speed. Check first: what "
                "rubs more the faster it moves"));
  rising.parameters = {{"drop_nm", 0.2}};
  EXPECT_THAT(as_shown(rising).name, HasSubstr("(Stribeck)"));
}

}  // namespace
}  // namespace servotwin
