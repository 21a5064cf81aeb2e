// Rules by which a cause is named.
#include "diagnosis/search/judgement.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "diagnosis/search/conclusion.h"
#include "diagnosis/search/diagnose.h"

namespace servotwin {
namespace {

constexpr double kMetres = 1.0;  // a linear axis

Effect mode_with(double damping_ratio) {
  Effect mode = make_effect<Compliance>();
  mode.shape = {11.2, damping_ratio};
  return mode;
}

/// A loop with one pair of poles, sampled at 1 kHz.
Model loop_with(double frequency_hz, double damping_ratio) {
  Model model;
  model.sample_time_s = 1e-3;
  model.loop.order = 2;
  const double omega = 2.0 * std::numbers::pi * frequency_hz;
  model.loop.denominator = {2.0 * damping_ratio * omega, omega * omega, 0.0};
  return model;
}

/// A hypothesis that leaves this error in each of 80 pieces, more in some of them than in others.
Hypothesis leaving(double rms) {
  Hypothesis out;
  for (int i = 0; i < 80; ++i) out.pieces.push_back(rms * rms * (1.0 + 0.2 * std::sin(i)));
  return out;
}

// Beside 2 um of friction a tenth of that may be the misfit of its law. Of 0.1 um a mode may take a
// part there, and not nearly all.
TEST(Judged, WhatExplainsNearlyAllIsNoMisfitOfALaw) {
  const Hypothesis before = leaving(0.1e-6);
  const Bar bar{2e-6, 2e-6, 10};
  const auto earned = [&](double left, std::size_t kind) {
    Screened screened;
    screened.kind = kind;
    return judged({leaving(left * 0.1e-6), &before, screened}, bar).earned;
  };
  EXPECT_FALSE(earned(0.45, kind_of<Compliance>()));
  EXPECT_TRUE(earned(0.35, kind_of<Compliance>()));
  EXPECT_TRUE(earned(0.45, kind_of<Cogging>())) << "no misfit of a law looks like it";
}

TEST(EndOfACause, AModeThatIsDampedAsAFilterIsNoCompliance) {
  EXPECT_TRUE(at_end_of("compliance", loop_with(20.0, 0.7), mode_with(0.2), kMetres));
  EXPECT_TRUE(at_end_of("compliance", loop_with(20.0, 0.7), mode_with(0.1999), kMetres));
  EXPECT_FALSE(at_end_of("compliance", loop_with(20.0, 0.7), mode_with(0.1), kMetres));
  Effect fast = mode_with(0.03);
  fast.shape[0] = 400.0;  // below half of the sampling rate
  EXPECT_FALSE(at_end_of("compliance", loop_with(20.0, 0.7), fast, kMetres));
}

// Beyond half of the sampling rate the mode has become the loop, and the loop's pair must vibrate.
TEST(EndOfACause, AComplianceThatDoesNotVibrateIsNone) {
  Effect exchanged = mode_with(0.03);
  exchanged.shape[0] = 600.0;
  EXPECT_FALSE(at_end_of("compliance", loop_with(34.0, 0.05), exchanged, kMetres));
  EXPECT_EQ(end_text("compliance", loop_with(34.0, 0.87), exchanged, kMetres),
            "no vibration with a damping ratio below 0.2: a filter or a delay");
  EXPECT_TRUE(at_end_of("compliance", loop_with(34.0, 1.3), exchanged, kMetres))
      << "two real poles";
  const auto vibration = vibration_of(loop_with(34.0, 0.05), exchanged);
  ASSERT_TRUE(vibration);
  EXPECT_NEAR(vibration->frequency_hz, 34.0, 1e-9);
  EXPECT_NEAR(vibration->damping_ratio, 0.05, 1e-9);
}

TEST(EndOfACause, IsSaidWithTheParameterItsLimitAndWhatItMeans) {
  EXPECT_EQ(end_text("compliance", loop_with(20.0, 0.7), mode_with(0.2), kMetres),
            "damping ratio at its limit 0.2: more is a filter than a vibration");
  EXPECT_EQ(end_text("compliance", loop_with(20.0, 0.7), mode_with(0.1), kMetres), "");
}

TEST(EndOfACause, FrictionThatIsNearlyGoneAtRestStandsForSomethingElse) {
  Effect law = make_effect<LuGre>();
  const auto shapes = shapes_of(law.kind);
  const auto ratio = std::find_if(shapes.begin(), shapes.end(),
                                  [](const Parameter& p) { return p.name == "breakaway_ratio"; }) -
                     shapes.begin();
  for (std::size_t i = 0; i < shapes.size(); ++i) law.shape[i] = shapes[i].start;
  law.shape[static_cast<std::size_t>(ratio)] = 0.2001;
  for (const char* cause : {"presliding", "stribeck"}) {
    EXPECT_EQ(end_text(cause, loop_with(20.0, 0.7), law, kMetres),
              "breakaway ratio at its limit 0.2: it stands for something else");
  }
  law.shape[static_cast<std::size_t>(ratio)] = 0.3;
  EXPECT_EQ(end_text("stribeck", loop_with(20.0, 0.7), law, kMetres), "");
}

TEST(EndOfACause, AnAngleOfAFastMotorIsNoLengthOfAMachine) {
  Effect friction = make_effect<Presliding>();
  const Parameter& way = shapes_of(friction.kind)[0];
  ASSERT_EQ(way.upper, 2e-3);
  friction.shape[0] = 7e-3;
  EXPECT_THAT(end_text("presliding", loop_with(20.0, 0.7), friction, kMetres),
              testing::HasSubstr("limit 0.002"));
  EXPECT_EQ(end_text("presliding", loop_with(20.0, 0.7), friction, 30.0), "");
  friction.shape[0] = 0.06;
  EXPECT_THAT(end_text("presliding", loop_with(20.0, 0.7), friction, 30.0),
              testing::HasSubstr("limit 0.06"));
}

TEST(EndOfACause, ADelayWithinASampleMayComeFromTheRecording) {
  Effect delay = make_effect<TimeDelay>();
  delay.shape[0] = 0.45e-3;
  EXPECT_EQ(end_text("time_delay", loop_with(20.0, 0.7), delay, kMetres),
            "shorter than half a sampling time: it may come from the recording");
  delay.shape[0] = 0.55e-3;
  EXPECT_FALSE(at_end_of("time_delay", loop_with(20.0, 0.7), delay, kMetres));
}

// A loop on two masses took the longest delay there is, and its feed-forward took it back.
TEST(EndOfACause, ADelayAtItsLimitOrTakenBackByTheLoopStandsForSomethingElse) {
  Effect delay = make_effect<TimeDelay>();
  delay.shape[0] = 0.05;
  EXPECT_EQ(end_text("time_delay", loop_with(20.0, 0.7), delay, kMetres),
            "at its limit of 50 ms: it stands for something else");
  delay.shape[0] = 5e-3;
  Model model = loop_with(20.0, 0.7);
  model.effects = {delay};
  model.loop.numerator[0] = 0.5;
  EXPECT_FALSE(at_end_of("time_delay", model, delay, kMetres));
  model.loop.numerator[0] = -3.0;  // four times the force that the moved mass needs
  EXPECT_THAT(end_text("time_delay", model, delay, kMetres),
              testing::HasSubstr("imitates a velocity lag"));
}

// On a rotary table three of the six parameters of such friction were at their bounds.
TEST(EndOfACause, FrictionThatBuildsUpOverTheLongestTravelIsSomethingElse) {
  Effect presliding = make_effect<Presliding>();
  presliding.shape = {2e-3, kMaxShape};
  EXPECT_EQ(end_text("presliding", loop_with(20.0, 0.7), presliding, kMetres),
            "breakaway displacement at its limit 0.002: what builds up over so long a travel is "
            "something else");
}

TEST(EndOfACause, OtherCausesHaveNone) {
  Effect presliding = make_effect<Presliding>();
  presliding.shape = {1e-3, kMaxShape};
  EXPECT_FALSE(at_end_of("presliding", loop_with(20.0, 0.7), presliding, kMetres));
  EXPECT_THROW((void)at_end_of("no_cause", loop_with(20.0, 0.7), presliding, kMetres),
               std::invalid_argument);
}

/// A diagnosis that these effects explain, each with a clear gain, before it is concluded.
Diagnosis explained_by(const std::vector<std::pair<std::string, Effect>>& causes) {
  Diagnosis diagnosis;
  diagnosis.baseline.holdout = {10e-6, 50e-6};
  diagnosis.extended.holdout = {1e-6, 5e-6};
  Model& model = diagnosis.extended.model;
  model.sample_time_s = 0.001;
  model.loop.denominator = {300.0, 3e4, 1e6};
  diagnosis.baseline.model = model;
  for (const auto& [id, effect] : causes) {
    Cause cause;
    cause.id = id;
    cause.place = model.effects.size();
    cause.wins = 1.0;
    cause.gain.before = 10e-6;
    cause.gain.after = 1e-6;
    cause.gain.low = 8e-6;
    cause.gain.high = 10e-6;
    cause.worth = 1e-10;
    diagnosis.causes.push_back(cause);
    model.effects.push_back(effect);
  }
  return diagnosis;
}

/// Concludes on this motion, or on one at many speeds.
void conclude(Diagnosis& diagnosis,
              const Eigen::ArrayXd& command = 0.01 *
                                              Eigen::ArrayXd::LinSpaced(2000, 0.0, 6.0).sin()) {
  SegmentedAxis axis;
  Segment s;
  s.sample_time_s = 0.001;
  s.command = command;
  s.actual = s.command;
  axis.sample_time_s = s.sample_time_s;
  axis.segments.push_back(s);
  NoiseFloor floor;
  floor.rms = 0.1e-6;
  conclude(diagnosis, axis, axis.segments, floor, {});
}

// A clean machine got four pushes where the residual was its noise.
TEST(Pushes, AreNamedOnlyWhereTheyStandOutOfTheNoiseOfTheTrainingData) {
  for (const double training : {0.11e-6, 0.5e-6}) {
    Diagnosis diagnosis =
        explained_by({{"impulse_disturbance", make_effect<ImpulseDisturbance>()}});
    diagnosis.baseline.training = {training, 10.0 * training};
    diagnosis.baseline.holdout = diagnosis.extended.holdout = {0.1e-6, 0.4e-6};
    Gain& gain = diagnosis.causes.front().gain;
    gain.before = gain.after = 0.1e-6;
    gain.low = -1e-9;
    gain.high = 1e-9;
    conclude(diagnosis);
    EXPECT_EQ(diagnosis.causes.size(), training > 0.2e-6 ? 1U : 0U);
    EXPECT_EQ(diagnosis.suspected.size(), training > 0.2e-6 ? 0U : 1U);
  }
}

TEST(CommonPeriod, OfTwoCausesMakesThemAmbiguous) {
  Effect lead = make_effect<LeadError>(), encoder = make_effect<EncoderError>();
  const auto set_period = [](Effect& effect, double period) {
    std::size_t i = 0;
    while (shapes_of(effect.kind)[i].name != "period") ++i;
    effect.shape[i] = period;
  };
  set_period(lead, 3.399e-3);
  for (const double period : {3.4e-3, 5e-3}) {
    set_period(encoder, period);
    Diagnosis diagnosis = explained_by({{"lead_error", lead}, {"encoder_error", encoder}});
    conclude(diagnosis);
    ASSERT_EQ(diagnosis.causes.size(), 2U);
    for (const Cause& cause : diagnosis.causes)
      EXPECT_EQ(cause.ambiguous_with.size(), period < 4e-3 ? 1U : 0U) << cause.id;
  }
}

/// A stroke back and forth, the way there at `there` [m/s] and the way back at `back`.
Eigen::ArrayXd stroke(double there, double back) {
  Eigen::ArrayXd out(2000);
  out << Eigen::ArrayXd::LinSpaced(1000, 0.0, there),
      Eigen::ArrayXd::LinSpaced(1000, there, there - back);
  return out;
}

// A rotary table that was recorded at one speed had a "pitch error of the screw".
TEST(OneSpeed, DoesNotTellAForceFromAnErrorOfTheReading) {
  for (const double back : {0.05, 0.02}) {
    Diagnosis diagnosis = explained_by({{"lead_error", make_effect<LeadError>()}});
    conclude(diagnosis, stroke(0.05, back));
    if (back == 0.05) {
      EXPECT_TRUE(diagnosis.causes.empty());
      ASSERT_EQ(diagnosis.suspected.size(), 1U);
      EXPECT_THAT(diagnosis.suspected.front().ambiguous_with,
                  testing::ElementsAre("cogging", "encoder_error"));
    } else {
      ASSERT_EQ(diagnosis.causes.size(), 1U) << "two speeds tell";
      EXPECT_THAT(diagnosis.causes.front().ambiguous_with, testing::IsEmpty());
    }
  }
}

TEST(OneSpeed, IsSeenThroughRampsAndACoarseCommand) {
  // Accelerates over a tenth of the way; the command has steps of 20 um, 2.5 in a sample.
  Eigen::ArrayXd command = Eigen::ArrayXd::Zero(2000);
  double speed = 0.0;
  for (Eigen::Index k = 1; k < command.size(); ++k) {
    speed = std::min(0.05, speed + 0.05 / 200.0);
    command(k) = command(k - 1) + 1e-3 * speed;
  }
  constexpr double kResolution = 20e-6;
  command = (command / kResolution).round() * kResolution;
  Diagnosis diagnosis = explained_by({{"cogging", make_effect<Cogging>()}});
  conclude(diagnosis, command);
  EXPECT_TRUE(diagnosis.causes.empty());
}

TEST(OneSpeed, ConcernsOnlyWhatRepeatsWithPosition) {
  Diagnosis diagnosis = explained_by({{"presliding", make_effect<Presliding>()}});
  conclude(diagnosis, stroke(0.05, 0.05));
  ASSERT_EQ(diagnosis.causes.size(), 1U);
  EXPECT_THAT(diagnosis.causes.front().ambiguous_with, testing::IsEmpty());
}

TEST(EndOfACause, KeepsACauseFromBeingNamedHoweverConfident) {
  for (const CauseDoubt doubt : {CauseDoubt::kNone, CauseDoubt::kParameters}) {
    Diagnosis diagnosis = explained_by({{"compliance", mode_with(0.2)}});
    diagnosis.causes.front().doubt = doubt;
    conclude(diagnosis);
    EXPECT_EQ(diagnosis.causes.size(), doubt == CauseDoubt::kNone ? 1U : 0U);
    EXPECT_EQ(diagnosis.suspected.size(), doubt == CauseDoubt::kNone ? 0U : 1U);
    if (doubt == CauseDoubt::kParameters) {
      EXPECT_EQ(diagnosis.verdict, Verdict::kUnexplained);
    }
  }
}

// Fitted beside the loop as it is, and with a loop that was fitted along the measured motion: the
// two begin with different errors.
TEST(ShareWon, ComparesTheSharesThatRivalsRemove) {
  constexpr std::size_t kPieces = 40;
  const auto with = [](double square) {
    Hypothesis h;
    for (std::size_t i = 0; i < kPieces; ++i)
      h.pieces.push_back(square * (1.0 + 0.1 * static_cast<double>(i % 5)));
    return h;
  };
  const Hypothesis as_is = with(1.0), fitted = with(4.0);
  const Tried best{with(0.1), &as_is, {}}, rival{with(1.0), &fitted, {}};
  EXPECT_EQ(share_won(best, rival), 1.0) << "90 % against 75 %, though 0.9 against 3";
  EXPECT_EQ(share_won(rival, best), 0.0);
}

}  // namespace
}  // namespace servotwin
