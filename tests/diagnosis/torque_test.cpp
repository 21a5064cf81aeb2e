// Causes in the torque: named with their sizes where they are present, and none where there is
// none. The torque is computed in closed form along a known motion, without any code of the twin.
#include "diagnosis/torque/torque.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <random>

#include "diagnosis/report/diagnosis_file.h"
#include "diagnosis/report/torque_text.h"
#include "diagnosis/torque/torque_body.h"
#include "diagnosis/torque/torque_rows.h"
#include "drivers/recordings/recording_file.h"
#include "tests/support/real_data.h"

namespace servotwin {
namespace {

using testing::Contains;
using testing::ElementsAre;
using testing::IsEmpty;
using testing::Not;
using testing::SizeIs;

constexpr double kPi = std::numbers::pi;

std::vector<std::string> ids(const TorqueDiagnosis& diagnosis) {
  std::vector<std::string> out;
  for (const TorqueCause& cause : diagnosis.causes) out.push_back(cause.id);
  return out;
}

double value(const TorqueDiagnosis& diagnosis, const std::string& id, const std::string& key) {
  for (const TorqueCause& cause : diagnosis.causes) {
    for (const auto& [name, number] : cause.parameters) {
      if (cause.id == id && name == key) return number;
    }
  }
  return kAbsent;
}

struct Body {
  double mass = 90.0, coulomb = 20.0, viscous = 200.0;
  double noise = 0.5;
  std::uint64_t seed = 1;
  Eigen::Index samples = 20'000;         // 1 ms apart
  double reach = 1.0;                    // of the motion
  double fast_hz = 2.3, fast_m = 0.006;  // of its third sine
};

/// Motion of three sines that does not repeat, with an additional force `more(x, v, t)`.
template <class More>
SegmentedAxis recorded(const Body& body, const More& more) {
  constexpr double kStep_s = 1e-3, kQuantum = 1e-7;
  std::mt19937_64 random(body.seed);
  std::normal_distribution<double> noise(0.0, body.noise);
  std::uniform_real_distribution<double> any(0.8, 1.25);
  const std::array<double, 3> amplitude{0.10 * body.reach * any(random),
                                        0.03 * body.reach * any(random),
                                        body.fast_m * body.reach * any(random)};
  const std::array<double, 3> hz{0.23 * any(random), 0.71 * any(random),
                                 body.fast_hz * any(random)};
  SegmentedAxis out;
  out.axis = "X";
  out.torque_unit = "N";
  out.sample_time_s = kStep_s;
  Segment s;
  s.sample_time_s = kStep_s;
  s.command.resize(body.samples);
  s.actual.resize(body.samples);
  s.torque.resize(body.samples);
  for (Eigen::Index k = 0; k < s.size(); ++k) {
    const double t = kStep_s * static_cast<double>(k);
    double x = 0.0, v = 0.0, a = 0.0;
    for (std::size_t i = 0; i < 3; ++i) {
      const double w = 2.0 * kPi * hz[i];
      x += amplitude[i] * std::sin(w * t);
      v += amplitude[i] * w * std::cos(w * t);
      a -= amplitude[i] * w * w * std::sin(w * t);
    }
    s.actual(k) = kQuantum * std::round(x / kQuantum);
    s.command(k) = x + 5e-3 * v;
    s.torque(k) = body.mass * a + body.coulomb * std::tanh(v / 4e-4) + body.viscous * v +
                  more(x, v, t) + noise(random);
  }
  out.segments = {s};
  return out;
}

class ACleanBody : public testing::TestWithParam<std::uint64_t> {};

TEST_P(ACleanBody, GetsNoCauseFromItsTorque) {
  std::mt19937_64 random(GetParam());
  std::uniform_real_distribution<double> any(0.3, 3.0);
  const Body body{60.0 * any(random), 20.0 * any(random), 150.0 * any(random), 1.0 * any(random),
                  GetParam()};
  const TorqueDiagnosis diagnosis =
      diagnose_torque(recorded(body, [](double, double, double) { return 0.0; }));
  EXPECT_THAT(ids(diagnosis), IsEmpty()) << testing::PrintToString(diagnosis.steps);
  EXPECT_FALSE(diagnosis.opposite);
  EXPECT_NEAR(diagnosis.mass, body.mass, 0.02 * body.mass);
  EXPECT_NEAR(diagnosis.coulomb, body.coulomb, 0.05 * body.coulomb);
  EXPECT_NEAR(diagnosis.viscous, body.viscous, 0.1 * body.viscous);
  EXPECT_EQ(diagnosis.baseline_rms, diagnosis.extended_rms);
}
INSTANTIATE_TEST_SUITE_P(Seeds, ACleanBody, testing::Range<std::uint64_t>(1, 13));

/// What a first-order filter with this time constant makes of the torque.
SegmentedAxis filtered(SegmentedAxis axis, double constant_s) {
  Segment& s = axis.segments.front();
  double out = s.torque(0);
  for (Eigen::Index k = 0; k < s.size(); ++k) {
    out += (s.torque(k) - out) * s.sample_time_s / (constant_s + s.sample_time_s);
    s.torque(k) = out;
  }
  return axis;
}

TEST(Torque, AFilteredTorqueIsPutInTimeBeforeAnythingIsReadFromIt) {
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U}) {
    SCOPED_TRACE(seed);
    const SegmentedAxis sharp =
        recorded({.coulomb = 40.0, .seed = seed}, [](double, double, double) { return 0.0; });
    const TorqueDiagnosis in_time = diagnose_torque(sharp),
                          late = diagnose_torque(filtered(sharp, 5e-3));
    EXPECT_EQ(in_time.lag.s, 0.0);
    EXPECT_NEAR(late.lag.s, 5e-3, 0.5e-3);
    EXPECT_TRUE(late.lag.filter);
    EXPECT_NEAR(late.mass, 90.0, 2.0);
    EXPECT_THAT(ids(late), IsEmpty()) << testing::PrintToString(late.steps);
  }
}

TEST(Torque, ATorqueOfALaterCycleIsPutInTime) {
  for (const int cycles : {3, -3}) {
    SegmentedAxis shifted =
        recorded({.coulomb = 40.0, .seed = 5}, [](double, double, double) { return 0.0; });
    const Eigen::ArrayXd torque = shifted.segments.front().torque;
    for (Eigen::Index k = 0; k < torque.size(); ++k)
      shifted.segments.front().torque(k) =
          torque(std::clamp<Eigen::Index>(k - cycles, 0, torque.size() - 1));
    const TorqueDiagnosis found = diagnose_torque(shifted);
    EXPECT_NEAR(found.lag.s, 1e-3 * cycles, 0.2e-3);
    EXPECT_FALSE(found.lag.filter);
    EXPECT_THAT(ids(found), IsEmpty()) << testing::PrintToString(found.steps);
  }
}

TEST(Torque, FrictionIsNoLag) {
  // Force that builds up over 20 um of travel after a reversal: late there, and not elsewhere.
  double turned_at = 0.0, direction = 0.0;
  const TorqueDiagnosis found =
      diagnose_torque(recorded({.coulomb = 0.0}, [&](double x, double v, double) {
        if (v * direction <= 0.0) turned_at = x, direction = v > 0.0 ? 1.0 : -1.0;
        return 40.0 * direction * (1.0 - 2.0 * std::exp(-std::abs(x - turned_at) / 20e-6));
      }));
  EXPECT_EQ(found.lag.s, 0.0);
  EXPECT_THAT(ids(found), Contains("presliding"));
}

TEST(Torque, WhatABriefRecordHasByChanceIsNoCause) {
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    SCOPED_TRACE(seed);
    const TorqueDiagnosis diagnosis = diagnose_torque(recorded(
        {90.0, 20.0, 200.0, 20.0, seed, 4'000}, [](double, double, double) { return 0.0; }));
    EXPECT_THAT(ids(diagnosis), IsEmpty()) << testing::PrintToString(diagnosis.steps);
  }
}

TEST(Torque, NamesAConstantForceInTheRecordsOwnSign) {
  SegmentedAxis axis = recorded({}, [](double, double, double) { return 60.0; });
  const TorqueDiagnosis along = diagnose_torque(axis);
  EXPECT_THAT(ids(along), ElementsAre("gravity_offset"));
  EXPECT_THAT(along.causes.front().ambiguous_with, IsEmpty());
  EXPECT_NEAR(value(along, "gravity_offset", "offset_n"), 60.0, 0.2);
  EXPECT_FALSE(along.opposite);
  EXPECT_GT(along.causes.front().gain.low, 0.0);
  EXPECT_NEAR(along.causes.front().gain.after, 0.5, 0.3);  // the noise within 40 Hz is less

  axis.segments.front().torque *= -1.0;
  const TorqueDiagnosis against = diagnose_torque(axis);
  EXPECT_THAT(ids(against), ElementsAre("gravity_offset"));
  EXPECT_TRUE(against.opposite);
  EXPECT_NEAR(value(against, "gravity_offset", "offset_n"), -60.0, 0.2);
  EXPECT_GT(against.mass, 0.0);
}

TEST(Torque, TheGravityOfALoadThatSwingsBelongsToTheBody) {
  constexpr double kLargestAt_rad = 0.7;
  SegmentedAxis axis =
      recorded({.mass = 9.0, .coulomb = 2.0, .viscous = 3.0, .noise = 0.3, .reach = 12.0},
               [](double x, double, double) { return 25.0 * std::cos(x - kLargestAt_rad); });
  axis.torque_unit = "Nm";
  axis.rotary = true;
  const TorqueDiagnosis diagnosis = diagnose_torque(axis);
  EXPECT_THAT(ids(diagnosis), IsEmpty()) << testing::PrintToString(diagnosis.steps);
  EXPECT_NEAR(diagnosis.gravity, 25.0, 0.25);
  EXPECT_NEAR(diagnosis.gravity_at_rad, kLargestAt_rad, 0.01);
  EXPECT_NEAR(diagnosis.mass, 9.0, 0.18);
  EXPECT_NEAR(diagnosis.coulomb, 2.0, 0.1);
  EXPECT_NEAR(diagnosis.extended_rms, 0.3, 0.15);
}

/// The same motion with this white noise of the encoder [m].
SegmentedAxis noisy(SegmentedAxis axis, double rms_m) {
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise(0.0, rms_m);
  for (double& x : axis.segments.front().actual) x += noise(random);
  return axis;
}

TEST(Torque, ANoisyEncoderDoesNotTakeTheMassAway) {
  const SegmentedAxis axis = noisy(
      recorded({.coulomb = 40.0, .samples = 40'000}, [](double, double, double) { return 0.0; }),
      2e-4);
  TorqueRows whole(axis, 0.6, true, 40.0);
  ASSERT_LT(body_of(whole, false).mass, 0.5 * 90.0) << "the noise is too small to take it";
  const TorqueDiagnosis diagnosis = diagnose_torque(axis);
  EXPECT_LT(diagnosis.bandwidth_hz, 40.0);
  EXPECT_TRUE(diagnosis.mass_shown);
  EXPECT_NEAR(diagnosis.mass, 90.0, 0.1 * 90.0);
}

TEST(Torque, AShortRecordingWithAFineEncoderKeepsItsMassAndOneWithNoiseToo) {
  const auto nothing = [](double, double, double) { return 0.0; };
  const TorqueDiagnosis brief =
      diagnose_torque(recorded({.noise = 0.01, .samples = 2600}, nothing));
  EXPECT_TRUE(brief.mass_shown);
  EXPECT_NEAR(brief.mass, 90.0, 0.5);
  const TorqueDiagnosis coarse = diagnose_torque(noisy(recorded({.samples = 8000}, nothing), 1e-4));
  EXPECT_LT(coarse.bandwidth_hz, 40.0);
  EXPECT_NEAR(coarse.mass, 90.0, 0.1 * 90.0);
}

TEST(Torque, WithoutFrictionTheMassKeepsItsSignInANoisyEncoder) {
  for (const std::uint64_t seed : {3U, 4U, 5U, 6U, 7U, 9U}) {
    SCOPED_TRACE(seed);
    const SegmentedAxis axis = recorded({.coulomb = 0.0, .viscous = 0.0, .seed = seed},
                                        [](double, double, double) { return 0.0; });
    EXPECT_EQ(diagnose_torque(axis).bandwidth_hz, 40.0) << "a fine encoder";
    const TorqueDiagnosis diagnosis = diagnose_torque(noisy(axis, 2e-4));
    EXPECT_FALSE(diagnosis.opposite);
    EXPECT_NEAR(diagnosis.mass, 90.0, 0.12 * 90.0);
  }
}

TEST(Torque, ALagIsSeenBeforeTheBandIsChosen) {
  const TorqueDiagnosis late = diagnose_torque(filtered(
      recorded({.fast_hz = 9.0, .fast_m = 1e-3}, [](double, double, double) { return 0.0; }),
      0.01));
  EXPECT_EQ(late.bandwidth_hz, 40.0);
  EXPECT_NEAR(late.lag.s, 0.01, 1e-3);
  EXPECT_NEAR(late.coulomb, 20.0, 2.0);
  EXPECT_NEAR(late.mass, 90.0, 4.0);
}

/// Forwards at 0.2 m/s and back at 0.02 m/s, two seconds each: a tenth of the way is backwards, and
/// half of the time.
TEST(Torque, ASlowReturnIsADirectionOfItsOwn) {
  SegmentedAxis axis = recorded({}, [](double, double, double) { return 0.0; });
  Segment& s = axis.segments.front();
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise(0.0, 0.5);
  constexpr double kRise_s = 0.2, kStroke_s = 2.0;
  double x = 0.0;
  for (Eigen::Index k = 0; k < s.size(); ++k) {
    const double t = s.sample_time_s * static_cast<double>(k);
    const double u = std::fmod(t, kStroke_s),
                 fast = std::fmod(t, 2.0 * kStroke_s) < kStroke_s ? 0.2 : -0.02;
    const double to_end = std::min(u, kStroke_s - u), phase = kPi * std::min(1.0, to_end / kRise_s);
    const double v = fast * 0.5 * (1.0 - std::cos(phase));
    const double a = to_end < kRise_s ? std::copysign(1.0, kStroke_s - 2.0 * u) * fast * 0.5 * kPi /
                                            kRise_s * std::sin(phase)
                                      : 0.0;
    x += v * s.sample_time_s;
    s.command(k) = s.actual(k) = x;
    s.torque(k) = 90.0 * a + 20.0 * std::tanh(v / 4e-4) + 200.0 * v + noise(random);
  }
  const TorqueDiagnosis diagnosis = diagnose_torque(axis);
  EXPECT_NEAR(diagnosis.mass, 90.0, 2.0);
  EXPECT_NEAR(diagnosis.coulomb, 20.0, 1.0);
  EXPECT_NEAR(diagnosis.viscous, 200.0, 10.0);
  EXPECT_EQ(diagnosis.constant, 0.0);
  EXPECT_THAT(ids(diagnosis), IsEmpty()) << testing::PrintToString(diagnosis.steps);
}

TEST(Torque, AMassThatTheMotionDoesNotShowIsNoResult) {
  SegmentedAxis axis =
      recorded({.mass = 1e-3, .seed = 3}, [](double, double, double) { return 0.0; });
  const TorqueDiagnosis diagnosis = diagnose_torque(axis);
  EXPECT_FALSE(diagnosis.mass_shown);
  EXPECT_EQ(diagnosis.bandwidth_hz, 40.0);
  EXPECT_NE(torque_lines(diagnosis, false, {})[1].find("mass not shown"), std::string::npos);
}

// 20 N of friction and -60 N of weight.
TEST(Torque, OneDirectionShowsFrictionAndWeightTogether) {
  SegmentedAxis axis = recorded({}, [](double, double, double) { return 0.0; });
  Segment& s = axis.segments.front();
  constexpr double kSpeed_mps = 0.8, kFriction_n = 20.0, kWeight_n = -60.0;
  for (Eigen::Index k = 0; k < s.size(); ++k) {
    const double way = kSpeed_mps * s.sample_time_s * static_cast<double>(k);
    const Eigen::Index next = std::min(k + 1, s.size() - 1),
                       last = std::max<Eigen::Index>(k - 1, 0);
    const double v = (s.command(next) - s.command(last)) / s.sample_time_s;
    s.torque(k) += kFriction_n - 20.0 * std::tanh(v / 4e-4) + kWeight_n + 200.0 * kSpeed_mps;
    s.actual(k) += way;
  }
  for (Eigen::Index k = 0; k < s.size(); ++k)
    s.command(k) += kSpeed_mps * s.sample_time_s * static_cast<double>(k);
  const TorqueDiagnosis diagnosis = diagnose_torque(axis);
  EXPECT_NEAR(diagnosis.constant, kFriction_n + kWeight_n, 4.0);
  EXPECT_NEAR(diagnosis.mass, 90.0, 4.0);
  EXPECT_EQ(diagnosis.coulomb, 0.0);
  EXPECT_NEAR(diagnose_torque(noisy(axis, 2e-4)).mass, 90.0, 0.12 * 90.0);
  s.torque = -s.torque;
  const TorqueDiagnosis against = diagnose_torque(axis);
  EXPECT_TRUE(against.opposite);
  EXPECT_NEAR(against.mass, 90.0, 4.0);
  EXPECT_NEAR(against.constant, -(kFriction_n + kWeight_n), 4.0);
  EXPECT_NE(torque_lines(diagnosis, false, {})[1].find("friction and constant force together"),
            std::string::npos);
}

// A ripple that is gone after half of the recording is in the training data only.
TEST(Torque, ACauseThatHeldOutDataDoNotConfirmIsNotNamed) {
  const auto ripple = [](double x, double, double t) {
    return t < 11.0 ? 6.0 * std::sin(2.0 * kPi * x / 5e-3) : 0.0;
  };
  const TorqueDiagnosis diagnosis = diagnose_torque(recorded({}, ripple));
  EXPECT_THAT(ids(diagnosis), Not(Contains("cogging")));
  const auto cogging = std::find_if(diagnosis.suspected.begin(), diagnosis.suspected.end(),
                                    [](const TorqueCause& c) { return c.id == "cogging"; });
  ASSERT_NE(cogging, diagnosis.suspected.end()) << testing::PrintToString(diagnosis.steps);
  EXPECT_EQ(cogging->doubt, TorqueDoubt::kGain);
  EXPECT_LT(cogging->gain.low, 0.0);
  EXPECT_LE(diagnosis.extended_rms, diagnosis.baseline_rms);
}

TEST(Torque, ACauseThatLeavesMostOfTheResidualIsLessSure) {
  const auto confidence_beside = [](double noise) {
    const TorqueDiagnosis diagnosis =
        diagnose_torque(recorded({.noise = noise}, [](double x, double, double) {
          return 6.0 * std::sin(2.0 * kPi * x / 5e-3);
        }));
    for (const TorqueCause& cause : diagnosis.causes) {
      if (cause.id == "cogging") return cause.confidence;
    }
    return 0.0;
  };
  const double clear = confidence_beside(0.5), beside_noise = confidence_beside(12.0);
  EXPECT_GT(clear, 0.94);
  EXPECT_GT(beside_noise, 0.0) << "it is named";
  EXPECT_LT(beside_noise, clear - 0.1);
}

// The control makes the axis follow what it reads: an error of the reading shows in the torque.
TEST(Torque, ARippleOfTheReadingIsNoCogging) {
  constexpr double kPeriod_m = 5e-3;
  Diagnosis position;
  Effect error;
  error.kind = kind_of<EncoderError>();
  error.shape[0] = kPeriod_m;
  position.extended.model.effects = {error};
  position.causes.emplace_back().id = "encoder_error";
  const auto named_at = [&](double period_m) {
    TorqueDiagnosis torque;
    TorqueCause& cogging = torque.causes.emplace_back();
    cogging.id = "cogging";
    cogging.harmonics = {{period_m, 1.0, kAbsent}};
    heed(torque, position);
    EXPECT_EQ(torque.causes.size() + torque.suspected.size(), 1U);
    if (!torque.suspected.empty()) {
      EXPECT_EQ(torque.suspected.front().doubt, TorqueDoubt::kPosition);
    }
    return !torque.causes.empty();
  };
  EXPECT_FALSE(named_at(1.01 * kPeriod_m));
  EXPECT_TRUE(named_at(1.1 * kPeriod_m)) << "that is another period";
  position.causes.front().id = "cogging";
  EXPECT_TRUE(named_at(kPeriod_m)) << "the position shows a force as well";
}

TEST(Torque, OfTwoThatItCannotTellApartThePositionDecides) {
  TorqueDiagnosis torque;
  TorqueCause& weight = torque.causes.emplace_back();
  weight.id = "gravity_offset";
  weight.ambiguous_with = {"asymmetric_friction"};
  Diagnosis position;
  position.causes.emplace_back().id = "presliding";
  heed(torque, position);
  EXPECT_THAT(ids(torque), ElementsAre("gravity_offset"));
  position.causes.emplace_back().id = "asymmetric_friction";
  heed(torque, position);
  EXPECT_THAT(ids(torque), IsEmpty());
  const std::vector<std::string> lines = torque_lines(torque, false);
  EXPECT_THAT(lines, Contains("suspected   by torque gravity_offset: the position shows "
                              "asymmetric_friction, which does the same in the torque"));
}

TEST(Torque, AMomentIsFoundWhateverTheStamps) {
  for (const double start_s : {0.0, 1194.987, 1e6}) {
    SegmentedAxis axis = recorded(
        {}, [](double, double v, double t) { return t > 6.3 ? 9.0 * std::tanh(v / 4e-4) : 0.0; });
    axis.segments[0].start_s = start_s;
    const TorqueDiagnosis diagnosis = diagnose_torque(axis);
    EXPECT_THAT(ids(diagnosis), ElementsAre("added_friction")) << start_s;
    EXPECT_NEAR(value(diagnosis, "added_friction", "time_s") - start_s, 6.3, 0.1) << start_s;
    EXPECT_NEAR(value(diagnosis, "added_friction", "coulomb_n"), 9.0, 0.5) << start_s;
  }
}

TEST(Torque, ABeginningThatDiffersIsNoChange) {
  const SegmentedAxis axis = recorded(
      {}, [](double, double v, double t) { return t > 0.7 ? 0.0 : -9.0 * std::tanh(v / 4e-4); });
  EXPECT_THAT(ids(diagnose_torque(axis)), Not(Contains("added_friction")));
}

TEST(Torque, NamesUnlikeDirections) {
  const TorqueDiagnosis diagnosis = diagnose_torque(recorded({}, [](double, double v, double) {
    return 2.0 * std::abs(std::tanh(v / 4e-4)) + 40.0 * std::abs(v);
  }));
  EXPECT_THAT(ids(diagnosis), ElementsAre("asymmetric_friction"));
  EXPECT_NEAR(value(diagnosis, "asymmetric_friction", "coulomb_plus_n"), 22.0, 0.5);
  EXPECT_NEAR(value(diagnosis, "asymmetric_friction", "coulomb_minus_n"), 18.0, 0.5);
  EXPECT_NEAR(value(diagnosis, "asymmetric_friction", "viscous_plus"), 240.0, 6.0);
  EXPECT_NEAR(value(diagnosis, "asymmetric_friction", "viscous_minus"), 160.0, 6.0);
}

TEST(Torque, NamesCoggingByItsPeriod) {
  const TorqueDiagnosis diagnosis = diagnose_torque(recorded({}, [](double x, double, double) {
    return 3.0 * std::sin(2.0 * kPi * x / 0.016 + 0.4) + 1.0 * std::sin(2.0 * kPi * x / 0.008);
  }));
  EXPECT_THAT(ids(diagnosis), ElementsAre("cogging"));
  EXPECT_NEAR(value(diagnosis, "cogging", "period_m"), 0.016, 2e-5);
  EXPECT_NEAR(value(diagnosis, "cogging", "amplitude_n"), 3.0, 0.15);
  EXPECT_NEAR(value(diagnosis, "cogging", "amplitude_2_n"), 1.0, 0.15);
}

TEST(Torque, NamesFrictionThatFallsWithSpeed) {
  const TorqueDiagnosis diagnosis = diagnose_torque(recorded({}, [](double, double v, double) {
    return 10.0 * std::tanh(v / 4e-4) * std::exp(-std::abs(v) / 0.02);
  }));
  EXPECT_THAT(ids(diagnosis), ElementsAre("stribeck"));
  EXPECT_NEAR(value(diagnosis, "stribeck", "drop_n"), 10.0, 1.0);
  EXPECT_NEAR(value(diagnosis, "stribeck", "stribeck_velocity"), 0.02, 0.004);
}

// The force of a body behind backlash and a spring over the travel since the last reversal, before
// which the body slid at `level`: closed form.
double through_gap(double travel, double level, double stiffness, double width) {
  const double released = travel - level / stiffness;
  if (released < 0.0) return -level + stiffness * travel;
  if (released < width) return 0.0;
  return std::min(level, stiffness * (released - width));
}
// Masing branch of a virgin curve that approaches `level` exponentially.
double through_presliding(double travel, double level, double scale) {
  return level * (1.0 - 2.0 * std::exp(-0.5 * travel / scale));
}

/// An oscillation of +-10 mm with increasing frequency, and a force over the travel since the
/// reversal.
template <class Force>
SegmentedAxis driven(const Force& force, double lag_s = 0.0) {
  constexpr double kStep_s = 1e-3, kStroke = 0.02;
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise(0.0, 1.0);
  SegmentedAxis out;
  out.axis = "R";
  out.torque_unit = "N";
  out.sample_time_s = kStep_s;
  Segment s;
  s.sample_time_s = kStep_s;
  s.actual.resize(16'000);
  s.torque.resize(16'000);
  const auto phase_at = [](double t) { return 0.8 * t + 0.03 * t * t; };  // half cycles
  for (Eigen::Index k = 0; k < s.actual.size(); ++k) {
    const double t = kStep_s * static_cast<double>(k);
    const auto travel_at = [&](double when, double& direction) {
      const double phase = std::max(0.0, phase_at(when)), half = std::floor(phase);
      direction = std::fmod(half, 2.0) == 0.0 ? 1.0 : -1.0;
      return 0.5 * kStroke * (1.0 - std::cos(kPi * (phase - half)));
    };
    double direction = 0.0;
    const double travel = travel_at(t, direction);
    s.actual(k) = direction * (travel - 0.5 * kStroke);
    const double felt = travel_at(t - lag_s, direction);
    s.torque(k) = direction * force(felt) + noise(random);
  }
  s.command = s.actual;
  out.segments = {s};
  return out;
}

TEST(Plateau, PlayIsFoundInItsWidth) {
  for (const double width : {1e-3, 3e-3}) {
    SCOPED_TRACE(width);
    const TorqueDiagnosis diagnosis = diagnose_torque(
        driven([&](double s) { return through_gap(s, 500.0, 4e5, width); }), {}, false);
    EXPECT_THAT(ids(diagnosis), Contains("backlash")) << testing::PrintToString(diagnosis.steps);
    EXPECT_NEAR(value(diagnosis, "backlash", "width_m"), width, 0.05 * width);
    for (const Reversal& reversal : diagnosis.plateau.reversals) EXPECT_GT(reversal.ratio, 2.0);
    EXPECT_LT(diagnosis.extended_rms, 0.2 * diagnosis.baseline_rms);
  }
}

TEST(Plateau, FrictionThatGivesIsNoPlay) {
  for (const double scale : {2e-4, 1e-3, 2e-3}) {
    SCOPED_TRACE(scale);
    const TorqueDiagnosis smooth = diagnose_torque(
        driven([&](double s) { return through_presliding(s, 500.0, scale); }), {}, false);
    EXPECT_FALSE(smooth.plateau.found()) << smooth.plateau.statistic;
    for (const Reversal& reversal : smooth.plateau.reversals) EXPECT_LT(reversal.ratio, 1.0);
    EXPECT_THAT(ids(smooth), Not(Contains("backlash")));
    const TorqueDiagnosis straight = diagnose_torque(
        driven([&](double s) { return through_gap(s, 500.0, 500.0 / scale, 0.0); }), {}, false);
    EXPECT_FALSE(straight.plateau.found()) << straight.plateau.statistic;
    for (const Reversal& reversal : straight.plateau.reversals)
      EXPECT_NEAR(reversal.ratio, 1.0, 0.25);
    EXPECT_THAT(ids(straight), Not(Contains("backlash")));
  }
}

TEST(Plateau, ALagOfTheRecordIsNoPlay) {
  const TorqueDiagnosis diagnosis = diagnose_torque(
      driven([](double s) { return through_presliding(s, 500.0, 1e-3); }, 0.02), {}, false);
  EXPECT_FALSE(diagnosis.plateau.found()) << diagnosis.plateau.statistic;
  EXPECT_THAT(ids(diagnosis), Not(Contains("backlash")));
}

TEST(TorqueFile, ACauseOfBothHasTheEvidenceOfBoth) {
  const TorqueDiagnosis torque =
      diagnose_torque(recorded({}, [](double, double, double) { return 60.0; }));
  nlohmann::json file = {
      {"verdict", "explained"},
      {"causes", nlohmann::json::array({{{"id", "gravity_offset"},
                                         {"parameters", {{"offset_mps2", 0.7}}},
                                         {"evidence", {{{"test", "loop"}}}},
                                         {"gain", {{"holdout_rms_after_m", 1.0}}}}})}};
  add_torque(file, torque);
  ASSERT_THAT(file["causes"], SizeIs(1));
  const nlohmann::json& cause = file["causes"][0];
  EXPECT_THAT(cause["evidence"], SizeIs(2));
  EXPECT_EQ(cause["evidence"][0]["test"], "loop");
  EXPECT_EQ(cause["parameters"]["offset_mps2"], 0.7);
  EXPECT_NEAR(cause["parameters"]["offset_n"].get<double>(), 60.0, 0.2);
  EXPECT_EQ(cause["gain"]["holdout_rms_after_m"], 1.0);
  EXPECT_LT(cause["gain"]["holdout_rms_after_n"], cause["gain"]["holdout_rms_before_n"]);

  EXPECT_THAT(torque_beside(torque, "gravity_offset"), testing::HasSubstr("by torque as well: "));
  EXPECT_EQ(torque_beside(torque, "cogging"), "");
  const auto told_in = [](const std::vector<std::string>& lines) {
    return std::count_if(lines.begin(), lines.end(), [](const std::string& line) {
      return line.find("gravity_offset") != line.npos && line.find("docs/causes/") == line.npos;
    });
  };
  EXPECT_EQ(told_in(torque_lines(torque, false)), 1);
  EXPECT_EQ(told_in(torque_lines(torque, false, {"gravity_offset"})), 0);

  // Words and units for people, and why nothing is said about the loop.
  const std::vector<std::string> sentences = in_short(torque, "no command");
  ASSERT_THAT(sentences, SizeIs(2));
  EXPECT_THAT(sentences[0], testing::HasSubstr("shows a constant force (weight, counterbalance, "
                                               "cable) (offset 60"));
  EXPECT_THAT(sentences[0], testing::Not(testing::HasSubstr("_n")));
  EXPECT_THAT(sentences[1], testing::HasSubstr("was not judged: no command."));
  EXPECT_THAT(torque_page(torque, "rig.csv", "no command"),
              testing::AllOf(testing::HasSubstr("was not judged: no command."),
                             testing::Not(testing::HasSubstr("<td>gravity_offset"))));

  TorqueDiagnosis limited = torque;
  for (const char* id : {"torque_saturation", "cogging"}) limited.causes.emplace_back().id = id;
  add_torque(file, limited);
  ASSERT_THAT(file["causes"], SizeIs(3));
  EXPECT_EQ(file["causes"][0]["id"], "torque_saturation") << "as the verdict begins with it";
  EXPECT_EQ(file["causes"][2]["id"], "cogging");

  const nlohmann::json alone = torque_alone(torque, "no command");
  EXPECT_TRUE(alone["suspected"].is_array());
  EXPECT_TRUE(alone["not_observable"].is_array()) << "as in every diagnosis file";
  EXPECT_EQ(alone["schema"], "servotwin.diagnosis/1");
  EXPECT_EQ(alone["verdict"], "explained");
  EXPECT_EQ(alone["causes"][0]["id"], "gravity_offset");
  EXPECT_EQ(alone["position_loop"], "no command");
  EXPECT_TRUE(alone["causes"][0]["gain"].at("holdout_rms_before_m").is_null());
  EXPECT_TRUE(alone["baseline"].at("rms_m").is_null());
}

SegmentedAxis read(const std::filesystem::path& file, const std::string& axis,
                   const std::string& columns, double from_s = 0.0, double to_s = 1e9) {
  ReadOptions options;
  options.columns = columns;
  options.from_s = from_s;
  options.to_s = to_s;
  Recording recording = read_recording(file, options);
  (void)without_command(recording, axis);
  return segment_axis(recording, axis);
}

// The example machine, made by other code: constant loads of 8 and 25 N behind a screw of 20 mm
// lead, friction that slides after 20 um, and on Y falls with speed.
TEST(Torque, TellsTheLoadsAndTheFrictionOfTheExampleMachine) {
  const Recording recording =
      read_recording(std::string(SERVOTWIN_SOURCE_DIR) + "/examples/axis_production.csv", {});
  const double per_newton = 0.02 / (2.0 * kPi);
  const TorqueDiagnosis x = diagnose_torque(segment_axis(recording, "X")),
                        y = diagnose_torque(segment_axis(recording, "Y"));
  EXPECT_THAT(ids(x), testing::UnorderedElementsAre("gravity_offset", "presliding"));
  EXPECT_THAT(ids(y), testing::UnorderedElementsAre("gravity_offset", "presliding", "stribeck"));
  EXPECT_NEAR(value(x, "gravity_offset", "offset_nm"), 8.0 * per_newton, 0.02 * 8.0 * per_newton);
  EXPECT_NEAR(value(y, "gravity_offset", "offset_nm"), 25.0 * per_newton, 0.02 * 25.0 * per_newton);
  EXPECT_NEAR(value(x, "presliding", "breakaway_displacement"), 20e-6, 7e-6);
  // Loads below the friction level may also be asymmetric friction.
  EXPECT_THAT(x.causes.front().ambiguous_with, ElementsAre("asymmetric_friction"));
}

// This record shows -21 N m and 3.3 to 3.7 N m of Coulomb friction; its torque has the opposite
// sign to the position.
TEST(RealTorque, SinumerikAxisY1HoldsAConstantForce) {
  SERVOTWIN_REAL_DATA(file, "sinumerik_edge_5axis/axis_Y1.csv");
  const TorqueDiagnosis diagnosis = diagnose_torque(read(
      file, "Y1", "time=t_s[s],Y1.command=des_pos[mm],Y1.actual=enc_pos[mm],Y1.torque=torque[Nm]"));
  EXPECT_TRUE(diagnosis.opposite);
  EXPECT_THAT(ids(diagnosis), ElementsAre("gravity_offset"));
  EXPECT_NEAR(value(diagnosis, "gravity_offset", "offset_nm"), -20.75, 0.75);
  EXPECT_GT(value(diagnosis, "gravity_offset", "over_coulomb"), 5.0);
  EXPECT_THAT(diagnosis.causes.front().ambiguous_with, IsEmpty());
  EXPECT_GT(diagnosis.causes.front().gain.low, 0.0);
}

// A motor with LuGre friction: inertia 1.8e-4 to 1.9e-4, Coulomb 0.030 (in the recorded unit). The
// encoder is coarse: compared up to 40 Hz the inertia is 1.1e-4.
TEST(RealTorque, ACoarseEncoderLeavesTheInertia) {
  SERVOTWIN_REAL_DATA(file, "field_joints/servo_j1.tsv");
  ReadOptions options;
  options.rate_hz = 1000.0;
  Recording recording = read_recording(file, options);
  const bool commanded = !without_command(recording, "J");
  const TorqueDiagnosis diagnosis = diagnose_torque(segment_axis(recording, "J"), {}, commanded);
  EXPECT_NEAR(diagnosis.mass, 1.85e-4, 0.1e-4);
  EXPECT_NEAR(diagnosis.coulomb, 0.030, 0.002);
}

// A joint of a UR10e: about 10.7 A of gravity times -cos(angle), inertia 0.92 A s^2/rad and 1.38 A
// of Coulomb friction, with which 0.30 A are left.
TEST(RealTorque, AJointThatSwingsHasItsGravity) {
  SERVOTWIN_REAL_DATA(file, "field_joints/ur10e_joint2.csv");
  const TorqueDiagnosis diagnosis = diagnose_torque(
      read(file, "J", "time=t[s],J.actual=q2[rad],J.torque=i2[A]", 0.0, 60.0), {}, false);
  EXPECT_NEAR(diagnosis.gravity, 10.7, 0.2);
  EXPECT_NEAR(std::abs(diagnosis.gravity_at_rad), kPi, 0.1);
  EXPECT_NEAR(diagnosis.mass, 0.92, 0.1);
  EXPECT_NEAR(diagnosis.coulomb, 1.38, 0.1);
  EXPECT_LT(diagnosis.baseline_rms, 0.35);
  EXPECT_THAT(ids(diagnosis), Not(Contains("gravity_offset")));
}

// Published: 167 and 240 N s/m, 20.1 and 20.6 N, a ripple of 1.08 N at 2.5 mm, friction that
// changes at low speed; no position-dependent friction and no backlash.
TEST(RealTorque, EmpsIsExplainedAsPublished) {
  SERVOTWIN_REAL_DATA(file, "emps/DATA_EMPS.mat");
  DiagnoseOptions options;
  options.identify.training_share = 0.5;
  const SegmentedAxis axis =
      read(file, "X", "X.command=qg[m],X.actual=qm[m],X.torque=vir[N*35.15065]");
  // The published values are those of a torque that acts when it is recorded.
  TorqueRows rows(axis, 0.5, true, 40.0);
  const TorqueBody published = body_of(rows, false);
  EXPECT_NEAR(published.mass, 95.1, 0.5);
  EXPECT_NEAR(published.viscous, 203.5, 2.0);
  EXPECT_NEAR(published.coulomb, 20.4, 0.3);
  // It is the output of the controller, held for a cycle of 1 ms: it acts half a cycle later, and
  // by the lag of the amplifier, which is not published.
  const TorqueDiagnosis diagnosis = diagnose_torque(axis, options);
  EXPECT_LT(diagnosis.lag.s, -0.4e-3);
  EXPECT_GT(diagnosis.lag.s, -1.5e-3);
  EXPECT_FALSE(diagnosis.lag.filter);
  EXPECT_NEAR(diagnosis.mass, 95.1, 0.5);
  constexpr double kLeftWithoutLag_n = 1.39;  // by the causes of 0.2.0 before the lag was known
  EXPECT_LT(diagnosis.extended_rms, 0.75 * kLeftWithoutLag_n);
  EXPECT_EQ(ids(diagnosis).front(), "asymmetric_friction");
  EXPECT_THAT(ids(diagnosis), Contains("cogging"));
  EXPECT_THAT(ids(diagnosis), Contains("stribeck"));
  EXPECT_THAT(ids(diagnosis), Not(Contains("position_dependent_friction")));
  EXPECT_THAT(ids(diagnosis), Not(Contains("backlash")));
  EXPECT_NEAR(value(diagnosis, "cogging", "period_m"), 2.5e-3, 0.01e-3);
  // Published: 1.08 N, without the lag.
  EXPECT_NEAR(value(diagnosis, "cogging", "amplitude_n"), 1.08, 0.3);
  EXPECT_NEAR(value(diagnosis, "asymmetric_friction", "viscous_minus") -
                  value(diagnosis, "asymmetric_friction", "viscous_plus"),
              73.7, 6.0);
  for (const TorqueCause& cause : diagnosis.causes) EXPECT_GT(cause.gain.low, 0.0) << cause.id;
}

class AnOdriveRun : public testing::TestWithParam<const char*> {
 public:
  static constexpr const char* kColumns =
      "time=t_s[s],M.command=pos_cmd_counts[rev/8192],M.actual=pos_counts[rev/8192],"
      "M.torque=iq_A[A]";
};

// The orders in the map of the motor's holding current (the largest are 7, 28, 14, 36 and 12).
TEST_P(AnOdriveRun, HasItsCoggingInTheCurrent) {
  SERVOTWIN_REAL_DATA(file, std::string("odrive_cogging/slow_goodgains_2__") + GetParam() + ".csv");
  const TorqueDiagnosis diagnosis = diagnose_torque(read(file, "M", kColumns, 0.5));
  ASSERT_THAT(ids(diagnosis), ElementsAre("cogging"));
  std::vector<int> orders;
  for (const Harmonic& h : diagnosis.causes.front().harmonics)
    orders.push_back(static_cast<int>(std::lround(2.0 * kPi / h.period)));
  EXPECT_THAT(orders, testing::UnorderedElementsAre(7, 14, 28, 12, 36));
  EXPECT_THAT(diagnosis.causes.front().ambiguous_with, ElementsAre("periodic_disturbance"));
  EXPECT_LE(diagnosis.causes.front().confidence, 0.5);
  EXPECT_LT(diagnosis.extended_rms, 0.5 * diagnosis.baseline_rms);
}
INSTANTIATE_TEST_SUITE_P(Runs, AnOdriveRun,
                         testing::Values("nocomp_1", "nocomp_2", "comp_1", "comp_2"));

// The compensation adds the current that the motor needs, so that both records contain the ripple
// in the current; it reduces the error only.
TEST(RealTorque, OdrivesCompensationTakesTheErrorAway) {
  SERVOTWIN_REAL_DATA(without, "odrive_cogging/slow_goodgains_2__nocomp_1.csv");
  SERVOTWIN_REAL_DATA(with, "odrive_cogging/slow_goodgains_2__comp_1.csv");
  const auto error_at = [](const TorqueDiagnosis& diagnosis, int order) {
    for (const Harmonic& h : diagnosis.causes.front().harmonics) {
      if (std::lround(2.0 * kPi / h.period) == order) return h.tracking_error;
    }
    return kAbsent;
  };
  const TorqueDiagnosis before = diagnose_torque(read(without, "M", AnOdriveRun::kColumns, 0.5)),
                        after = diagnose_torque(read(with, "M", AnOdriveRun::kColumns, 0.5));
  for (const int order : {7, 14, 28})
    EXPECT_LT(error_at(after, order), 0.3 * error_at(before, order)) << order;
}

// A plot of the recording shows plateaus near zero force of 0.1 in one direction and 0.07 in the
// other.
TEST(RealTorque, TheBacklashRigHasItsPlateau) {
  SERVOTWIN_REAL_DATA(file, "brfd_backlash/d3_0.5Hz_30lb_0.5in.csv");
  const SegmentedAxis axis =
      read(file, "R", "time=t_s[s],R.actual=disp_in[in],R.torque=force_kip[kN*4.4482216]");
  const TorqueDiagnosis diagnosis = diagnose_torque(axis, {}, false);
  EXPECT_THAT(ids(diagnosis), ElementsAre("backlash"));
  EXPECT_NEAR(value(diagnosis, "backlash", "width_m"), 0.09 * 25.4e-3, 0.015 * 25.4e-3);
  EXPECT_GE(diagnosis.plateau.reversals.size(), 10u);
  EXPECT_GT(diagnosis.causes.front().gain.low, 0.0);
  EXPECT_FALSE(diagnosis.commanded);
}

TEST(Torque, WithoutACommandThePositionTakesItsPlace) {
  Recording recording;
  AxisRecord axis;
  axis.name = "R";
  axis.command = {kAbsent, kAbsent};
  axis.actual = {1.0, 2.0};
  axis.torque = {3.0, 4.0};
  recording.axes = {axis};
  EXPECT_FALSE(without_command(recording, "Q"));
  EXPECT_TRUE(without_command(recording, "R"));
  EXPECT_EQ(recording.axes[0].command, recording.axes[0].actual);
  EXPECT_FALSE(without_command(recording, "R"));
  recording.axes[0].command = {kAbsent, kAbsent};
  recording.axes[0].torque.clear();
  EXPECT_FALSE(without_command(recording, "R"));
}

}  // namespace
}  // namespace servotwin
