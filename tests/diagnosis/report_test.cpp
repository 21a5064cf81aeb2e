// The report: its plots show measured values and not those of the model, its text names the axis,
// the cause, its size and what to check, and the page is self-contained.
#include "diagnosis/report/report.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

#include "diagnosis/report/cause_picture.h"
#include "diagnosis/report/cause_words.h"
#include "diagnosis/report/diagnosis_file.h"
#include "diagnosis/report/in_short.h"
#include "twin/twin.h"
#include "twin/two_pi.h"

namespace servotwin {
namespace {

using testing::HasSubstr;
using testing::Not;

constexpr double kPeriod = 4e-3;

/// Strokes of 60 mm forwards and back at several speeds, with rests.
Segment commanded() {
  std::vector<double> x(500, 0.0);
  for (const double speed : {0.02, 0.05, 0.1, 0.03}) {
    for (int lap = 0; lap < 4; ++lap) {
      const double from = x.back(), to = lap % 2 == 0 ? 0.06 : 0.0;
      const auto n = static_cast<int>(0.06 / speed / 1e-3);
      for (int k = 1; k <= n; ++k) {
        const double s = static_cast<double>(k) / n;
        // Nearly constant speed except at the ends of the stroke.
        x.push_back(from + (to - from) * (s - std::sin(kTwoPi * s) / kTwoPi * 0.3));
      }
      x.insert(x.end(), 200, to);
    }
  }
  Segment s;
  s.sample_time_s = 1e-3;
  s.command = Eigen::Map<Eigen::ArrayXd>(x.data(), static_cast<Eigen::Index>(x.size()));
  return s;
}

Model plain(int order) {
  Model model;
  model.sample_time_s = 1e-3;
  model.loop.order = order;
  model.loop.denominator =
      order == 2 ? std::array{200.0, 12'000.0, 0.0} : std::array{250.0, 22'000.0, 600'000.0};
  model.loop.numerator = order == 2 ? std::array{1.0, 200.0, 0.0} : std::array{1.0, 190.0, 0.0};
  Effect coulomb = make_effect<CoulombFriction>();
  coulomb.coefficient[0] = 0.2;
  model.effects = {coulomb};
  return model;
}

/// A recording, and a diagnosis of it whose extended model has the effect at half its true size.
struct Case {
  Diagnosis diagnosis;
  Segment segment;
};

Case diagnosed(const std::string& id, const Model& without, const Effect& truth) {
  Case out;
  out.segment = commanded();
  Model machine = without;
  machine.effects.push_back(truth);
  out.segment.actual = out.segment.command - simulate(machine, out.segment);
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise(0.0, 2e-8);
  for (double& x : out.segment.actual) x += noise(random);
  Diagnosis& d = out.diagnosis;
  d.verdict = Verdict::kExplained;
  d.baseline.axis = "X";
  d.baseline.model = without;
  d.baseline.holdout = {2e-6, 9e-6};
  d.baseline.training_to_s = 4.0;
  d.extended = d.baseline;
  Effect half = truth;
  for (double& c : half.coefficient) c *= 0.5;
  d.extended.model.effects.push_back(half);
  d.extended.holdout = {1e-6, 5e-6};
  Cause cause;
  cause.id = id;
  cause.place = 1;
  cause.confidence = 0.97;
  cause.gain = {2e-6, 1e-6, 0.8e-6, 1.2e-6};
  cause.without = without;
  d.causes = {cause};
  return out;
}

const PlotSeries& series(const PlotPanel& panel, const std::string& name) {
  for (const PlotSeries& s : panel.series) {
    if (s.name == name) return s;
  }
  throw std::runtime_error("no series " + name);
}

double sine_in(const PlotSeries& s) {
  double sum = 0.0;
  for (std::size_t i = 0; i < s.x.size(); ++i)
    sum += s.y[i] * std::sin(kTwoPi * 1e-3 * s.x[i] / kPeriod);
  return 2.0 * sum / static_cast<double>(s.x.size());
}

class OfOrder : public testing::TestWithParam<int> {};

TEST_P(OfOrder, ARippleIsMeasuredAtItsSizeWhateverTheModelSays) {
  Effect ripple = make_effect<Cogging>();
  ripple.shape[0] = kPeriod;
  ripple.coefficient[0] = 0.04;
  const Case one = diagnosed("cogging", plain(GetParam()), ripple);
  const CausePicture picture =
      picture_of(one.diagnosis, one.diagnosis.causes.front(), {one.segment});
  ASSERT_EQ(picture.panels.size(), 1U);
  EXPECT_THAT(picture.panels[0].y_label, HasSubstr("[N/kg]"));
  EXPECT_NEAR(sine_in(series(picture.panels[0], "simulated with it")), 0.02, 0.001);
  EXPECT_NEAR(sine_in(series(picture.panels[0], "measured")), 0.04, 0.002);
  EXPECT_NEAR(sine_in(series(picture.panels[0], "simulated without it")), 0.0, 0.002);
}

INSTANTIATE_TEST_SUITE_P(Loops, OfOrder, testing::Values(2, 3));

TEST(PictureOf, UnlikeDirectionsAreMeasuredAtTheirSizes) {
  Effect unlike = make_effect<AsymmetricFriction>();
  unlike.coefficient[0] = 0.05;
  const Case one = diagnosed("asymmetric_friction", plain(2), unlike);
  const CausePicture picture =
      picture_of(one.diagnosis, one.diagnosis.causes.front(), {one.segment});
  ASSERT_GE(picture.panels.size(), 1U);
  // 0.2 in both directions, and 0.05 with the sign of the direction; the model has 0.025.
  const PlotSeries& measured = series(picture.panels[0], "measured");
  EXPECT_NEAR(measured.y.back(), 0.25, 0.01);
  EXPECT_NEAR(measured.y.front(), -0.15, 0.01);
  EXPECT_NEAR(series(picture.panels[0], "simulated with it").y.back(), 0.225, 0.005);
  EXPECT_NEAR(series(picture.panels[0], "simulated without it").y.back(), 0.2, 0.01);
}

TEST(PictureOf, AnErrorOfTheScrewIsALength) {
  Effect lead = make_effect<LeadError>();
  lead.shape[0] = kPeriod;
  lead.coefficient[1] = 3e-6;
  const Case one = diagnosed("lead_error", plain(2), lead);
  const CausePicture picture =
      picture_of(one.diagnosis, one.diagnosis.causes.front(), {one.segment});
  ASSERT_EQ(picture.panels.size(), 2U);
  EXPECT_THAT(picture.panels[0].y_label, HasSubstr("[um]"));
  EXPECT_NEAR(sine_in(series(picture.panels[0], "measured")), 3.0, 0.05);
  EXPECT_NEAR(sine_in(series(picture.panels[0], "simulated with it")), 1.5, 0.05);
}

TEST(PictureOf, FrictionAfterAReversalGoesOverToTheOtherSide) {
  Model without = plain(2);
  Effect presliding = make_effect<Presliding>();
  presliding.shape[0] = 4e-5;
  presliding.coefficient[0] = 0.3;
  without.effects[0].coefficient[0] = 0.0;
  const Case one = diagnosed("presliding", without, presliding);
  const CausePicture picture =
      picture_of(one.diagnosis, one.diagnosis.causes.front(), {one.segment});
  ASSERT_EQ(picture.panels.size(), 1U);
  const PlotSeries& measured = series(picture.panels[0], "measured");
  EXPECT_LT(measured.y.front(), -0.2);
  EXPECT_NEAR(measured.y.back(), 0.3, 0.02);
  EXPECT_GT(measured.x.back(), 100.0);  // [um]
  EXPECT_FALSE(measured.error.empty());
}

TEST(PictureOf, WhatWasCountedHasNone) {
  Case one = diagnosed("cogging", plain(2), make_effect<Cogging>());
  one.diagnosis.causes[0].place = kNoEffect;
  EXPECT_TRUE(
      picture_of(one.diagnosis, one.diagnosis.causes.front(), {one.segment}).panels.empty());
}

TEST(Words, SayWhichAxisWhatHowMuchAndWhatToDo) {
  Effect ripple = make_effect<Cogging>();
  ripple.shape[0] = kPeriod;
  ripple.coefficient[0] = 0.04;
  const Case one = diagnosed("cogging", plain(2), ripple);
  const std::string words = plain_verdict(one.diagnosis);
  EXPECT_THAT(words,
              HasSubstr("Axis X has a force ripple that repeats along the axis: +-0.02 N per "
                        "kg of moved mass, every 4 mm."));
  EXPECT_THAT(words, HasSubstr("error is now 1 um RMS instead of 2"));
  EXPECT_THAT(words, HasSubstr("Check first: what repeats with this period"));
}

TEST(Words, SayWhatARepairWouldBring) {
  Effect ripple = make_effect<Cogging>();
  ripple.shape[0] = kPeriod;
  Case one = diagnosed("cogging", plain(2), ripple);
  Gain& gain = one.diagnosis.causes[0].gain;
  gain.tracking_now = 9e-6;
  gain.tracking_repaired = 4e-6;
  EXPECT_THAT(plain_verdict(one.diagnosis),
              HasSubstr("Without it the tracking error of this motion would be 4 um RMS instead of "
                        "9."));
  gain.contour_now = 6e-6;
  gain.contour_repaired = 2e-6;
  EXPECT_THAT(plain_verdict(one.diagnosis),
              HasSubstr("contour error of this motion would be 2 um"));
  gain.contour_repaired = 5.99e-6;
  EXPECT_THAT(plain_verdict(one.diagnosis),
              HasSubstr("Its repair would not lower the contour error of this motion, 6 um RMS."));
}

TEST(Words, ALagThatIsADelayIsNotThatOfADrive) {
  Case one = diagnosed("cogging", plain(2), make_effect<Cogging>());
  one.diagnosis.lag = {1.7523e-3, 8.3e-3, 0.999};
  EXPECT_THAT(in_short(one.diagnosis, {}).front(),
              HasSubstr("1752 um RMS on held-out motion; 99.9 % of its square is a lag of 8.3 ms"));
  Effect delay = make_effect<TimeDelay>();
  delay.shape[0] = 8e-3;
  one.diagnosis.extended.model.effects.push_back(delay);
  EXPECT_THAT(in_short(one.diagnosis, {}).back(),
              HasSubstr("1752 um RMS on held-out motion; most of it is the delay of 8 ms between "
                        "command and encoder."));
  one.diagnosis.extended.model.effects.pop_back();
  one.diagnosis.lag.share = 0.6;
  EXPECT_THAT(in_short(one.diagnosis, {}).back(), HasSubstr("60 % of its square is a lag"))
      << "half of it: the cause comes first";
}

TEST(Words, EveryCauseOfTheContractHasAName) {
  for (const std::string_view id : contract_ids()) {
    EXPECT_NE(plain_name(std::string(id)), id);
    EXPECT_THAT(plain_name(std::string(id)), Not(HasSubstr("_")));
  }
}

TEST(Words, NoSizeOfACauseContainsAnIdentifier) {
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    const std::string id(is_friction_law(kind) ? "presliding" : identity_of(kind).cause);
    const std::array without_presliding{kind_of<CoulombFriction>(), kind_of<Stribeck>(),
                                        kind_of<ModifiedStribeck>()};
    if (id.empty() || std::find(without_presliding.begin(), without_presliding.end(), kind) !=
                          without_presliding.end())
      continue;
    Diagnosis d;
    d.extended.axis = "X";
    d.extended.model = plain(2);
    Effect effect;
    effect.kind = kind;
    std::size_t i = 0;
    for (const Parameter& p : shapes_of(kind)) effect.shape[i++] = p.start;
    i = 0;
    for (const Parameter& p : coefficients_of(kind))
      effect.coefficient[i++] = p.start > 0.0 ? p.start : 0.1;
    d.extended.model.effects.push_back(effect);
    Cause cause;
    cause.id = id;
    cause.place = 1;
    d.causes = {cause};
    EXPECT_THAT(plain_size(d, cause), Not(HasSubstr("_"))) << identity_of(kind).id;
  }
}

TEST(CausePage, IsAmongTheDocumentsForEveryCauseOfTheContract) {
  for (const std::string_view id : contract_ids()) {
    const std::string page = cause_page(std::string(id));
    EXPECT_TRUE(std::ifstream(std::filesystem::path(SERVOTWIN_SOURCE_DIR) / page)) << page;
    EXPECT_EQ(page_to_read(std::string(id)), page) << "nothing is installed beside this program";
  }
}

TEST(Report, NeedsNothingButItself) {
  Effect ripple = make_effect<Cogging>();
  ripple.shape[0] = kPeriod;
  ripple.coefficient[0] = 0.04;
  Case one = diagnosed("cogging", plain(2), ripple);
  one.diagnosis.baseline.axis = "<X>";
  one.diagnosis.causes[0].ambiguous_with = {"encoder_error"};
  one.diagnosis.suggested_test = suggested_test({{"cogging", "encoder_error"}},
                                                seen_motion({one.segment}), {.period = kPeriod});
  const std::string page = report_html(one.diagnosis, {one.segment}, "a & b.csv");
  EXPECT_THAT(page, HasSubstr("<summary>Frequency response</summary>"));
  EXPECT_THAT(page, HasSubstr("the twin"));
  for (const char* outside : {"src=", "href", "<script", "@import", "url(", "https:"})
    EXPECT_EQ(page.find(outside), std::string::npos) << outside;
  for (const char* inside :
       {"Axis &lt;X&gt;", "a &amp; b.csv", "it may also be</th><td>an error of the encoder",
        "docs/causes/cogging.md", "<summary>Suggested test</summary>",
        "It could also be an error of the encoder", "prefers-color-scheme:dark"})
    EXPECT_NE(page.find(inside), std::string::npos) << inside;
  // What the position names is not said again; nor is the limit, which has a sentence of its own.
  TorqueDiagnosis torque;
  for (const char* id : {"cogging", "backlash", "torque_saturation"})
    torque.causes.emplace_back().id = id;
  one.diagnosis.at_limit = "190 N in 6 moments";
  const std::string with_torque = report_html(one.diagnosis, {one.segment}, "a.csv", torque);
  EXPECT_THAT(with_torque, HasSubstr(" The torque shows play (backlash)."));
  EXPECT_THAT(with_torque, HasSubstr("<h2>Torque</h2>"));
  const std::size_t nan = page.find("nan");
  EXPECT_EQ(nan, std::string::npos) << page.substr(nan < 80 ? 0 : nan - 80, 120);
  std::size_t pictures = 0;
  for (std::size_t at = page.find("<svg"); at != std::string::npos; at = page.find("<svg", at + 1))
    ++pictures;
  EXPECT_EQ(pictures, 4U);  // the error, the cause, the test motion, the frequency response
}

}  // namespace
}  // namespace servotwin
