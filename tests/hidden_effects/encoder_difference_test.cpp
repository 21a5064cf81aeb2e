// What the difference of two encoders shows, of machines that share no code with the twin and whose
// gap, spring and friction are known.
#include "diagnosis/evidence/encoder_difference.h"

#include <gmock/gmock.h>

#include <cmath>
#include <numbers>
#include <random>

#include "diagnosis/statistics/text.h"
#include "drivers/recordings/recording_file.h"
#include "identification/recording/positions.h"
#include "tests/hidden_effects/rig.h"
#include "tests/support/temporary_directory.h"

namespace servotwin::hidden_effects {
namespace {

using testing::Contains;
using testing::HasSubstr;
using testing::Not;

constexpr virtual_machine::Limits kBriskDrive{.velocity = 0.2, .acceleration = 3.0, .jerk = 100.0};
constexpr virtual_machine::Limits kSlow{.velocity = 0.05, .acceleration = 1.0, .jerk = 40.0};

/// 100 kg, of which 60 kg are behind contact or spring, with 20 N of friction: 0.33 m/s^2.
Rig machine() {
  Rig rig;
  rig.body.spring_frequency_hz = 400.0;
  rig.body.damping_ratio = 0.1;
  rig.friction.level = 20.0;
  rig.friction.saturation_velocity = 1e-3;
  rig.drive.velocity_feedforward = 0.9;
  return rig;
}

virtual_machine::Trajectory path() {
  virtual_machine::Trajectory out(0.0);
  for (int i = 0; i < 6; ++i) {
    out.dwell(0.2);
    out.move_to(0.04 * (1 + i % 3), kBriskDrive);
    out.dwell(0.1);
    out.move_to(0.02, kSlow);
    out.move_to(-0.01 * (1 + i % 2), kBriskDrive);
  }
  out.dwell(0.2);
  return out;
}

/// Both encoders with noise and a step of 0.1 um each.
SegmentedAxis recorded_by_both(const Rig& rig, double step = 1e-7) {
  const Trace trace = simulate(rig, path());
  std::mt19937_64 random(3);
  std::normal_distribution<double> noise(0.0, 0.3 * step);
  const auto read = [&](const std::vector<double>& exact) {
    Eigen::ArrayXd out(static_cast<Eigen::Index>(exact.size()));
    for (Eigen::Index k = 0; k < out.size(); ++k)
      out(k) = step * std::round((exact[static_cast<std::size_t>(k)] + noise(random)) / step);
    return out;
  };
  Segment segment;
  segment.sample_time_s = rig.reading.sample_time;
  segment.command = Eigen::Map<const Eigen::ArrayXd>(
      trace.command.data(), static_cast<Eigen::Index>(trace.command.size()));
  segment.actual = read(rig.reading.recorded == Encoder::kLoad ? trace.exact : trace.load);
  segment.actual_motor = read(trace.motor);
  SegmentedAxis axis;
  axis.axis = "X";
  axis.sample_time_s = segment.sample_time_s;
  axis.segments.push_back(segment);
  return axis;
}

EncoderDifference found(const SegmentedAxis& axis) {
  const auto out = encoder_difference(axis);
  EXPECT_TRUE(out);
  return out.value_or(EncoderDifference());
}

/// 1 / omega^2 of the load with the motor held [s^2].
double compliance(double frequency_hz) {
  return std::pow(2.0 * std::numbers::pi * frequency_hz, -2.0);
}

void expect_term(const EncoderDifference::Term& term, double truth, double tolerance) {
  EXPECT_TRUE(term.shown);
  EXPECT_NEAR(term.value, truth, tolerance);
  EXPECT_LT(term.low, truth + tolerance);
  EXPECT_GT(term.high, truth - tolerance);
  EXPECT_LT(term.high - term.low, 0.05 * truth);
}

constexpr double kTenthOfAStep = 1e-8;

class AGapBetweenTheEncoders : public testing::TestWithParam<double> {};

TEST_P(AGapBetweenTheEncoders, IsPlayOfItsWidth) {
  Rig rig = machine();
  rig.body.gap = GetParam();
  const EncoderDifference d = found(recorded_by_both(rig));
  expect_term(d.play(), GetParam(), kTenthOfAStep);
  EXPECT_LT(d.left_rms, 2.0 * kTenthOfAStep);
  EXPECT_THAT(encoders_beside(d, "backlash"), HasSubstr("there is play of"));
}
INSTANTIATE_TEST_SUITE_P(Dev, AGapBetweenTheEncoders, testing::Values(2e-6, 12e-6, 60e-6));

// The step at reversals is that of friction: 2 F / k, k = m omega^2.
TEST(EncoderDifference, ShowsASpringWhichFrictionWindsUpWithoutPlay) {
  Rig rig = machine();
  rig.body.spring_frequency_hz = 40.0;
  const EncoderDifference d = found(recorded_by_both(rig));
  expect_term(d.compliance, compliance(40.0), 0.002 * compliance(40.0));
  expect_term(d.reversal, 2.0 * 20.0 / 60.0 * compliance(40.0), 5.0 * kTenthOfAStep);
  EXPECT_FALSE(d.play().shown);
  EXPECT_FALSE(d.undecided());
  EXPECT_THAT(plain_text(d), HasSubstr("swings at 40"));
  EXPECT_THAT(plain_text(d), Not(HasSubstr("play")));
  EXPECT_THAT(encoders_beside(d, "backlash"), HasSubstr("do not show it"));
  EXPECT_THAT(encoders_beside(d, "compliance"), HasSubstr("there is a spring of 40"));
}

// Drag on the load, B / 2, winds the spring up by v B / 2 k.
TEST(EncoderDifference, TellsPlayFromASpringWithFrictionAndDrag) {
  Rig rig = machine();
  rig.body.spring_frequency_hz = 60.0;
  rig.body.gap = 30e-6;
  rig.friction.viscous = 100.0;
  const EncoderDifference d = found(recorded_by_both(rig));
  expect_term(d.play(), 30e-6, 2.0 * kTenthOfAStep);
  expect_term(d.compliance, compliance(60.0), 0.002 * compliance(60.0));
  expect_term(d.delay, 50.0 / 60.0 * compliance(60.0), 1e-7);
}

// 300 N on 60 kg would wind a spring of 400 Hz up by 1.6 um; more is play that friction keeps
// closed.
TEST(EncoderDifference, ShowsPlayThatFrictionKeepsClosed) {
  Rig rig = machine();
  rig.body.gap = 12e-6;
  rig.friction.level = 300.0;
  const EncoderDifference d = found(recorded_by_both(rig));
  expect_term(d.play(), 12e-6 + 2.0 * 300.0 / 60.0 * compliance(400.0), 5.0 * kTenthOfAStep);
}

// 250 N on 60 kg: the load stops before it would cross a gap.
TEST(EncoderDifference, LeavesPlayAndFrictionUndecidedWhereTheLoadNeverChangesSides) {
  Rig rig = machine();
  rig.body.spring_frequency_hz = 40.0;
  rig.friction.level = 250.0;
  const EncoderDifference d = found(recorded_by_both(rig));
  EXPECT_TRUE(d.undecided());
  EXPECT_FALSE(d.play().shown);
  expect_term(d.reversal, 2.0 * 250.0 / 60.0 * compliance(40.0), 1e-6);
  EXPECT_THAT(plain_text(d), HasSubstr("by play or by friction"));
  EXPECT_EQ(encoders_beside(d, "backlash"), "");
}

TEST(EncoderDifference, ShowsNothingInNoiseAndSteps) {
  Rig rig = machine();
  rig.body.spring_frequency_hz = 0.0;
  for (const double step : {1e-7, 2e-6}) {
    const EncoderDifference d = found(recorded_by_both(rig, step));
    for (const auto* term : {&d.reversal, &d.other_side, &d.compliance, &d.delay, &d.scale})
      EXPECT_FALSE(term->shown) << step << ' ' << plain_text(d);
    EXPECT_THAT(plain_text(d), HasSubstr("The two encoders agree to"));
    // Two readings, each of a noise of 0.3 steps and rounded.
    EXPECT_NEAR(d.rms, step * std::sqrt(2.0 * (0.09 + 1.0 / 12.0)), 0.1 * step);
  }
}

// An encoder that slips by 3 um at random: any term is as large in some moves, and of the other
// sign in others.
TEST(EncoderDifference, ShowsNothingThatOtherMovesContradict) {
  Rig rig = machine();
  rig.body.spring_frequency_hz = 0.0;
  SegmentedAxis axis = recorded_by_both(rig);
  Eigen::ArrayXd& motor = axis.segments[0].actual_motor;
  std::mt19937_64 random(5);
  std::normal_distribution<double> slip(0.0, 3e-6);
  double slipped = 0.0;
  for (Eigen::Index k = 0; k < motor.size(); ++k) {
    if (k % 500 == 0) slipped = slip(random);
    motor(k) += slipped;
  }
  const EncoderDifference d = found(axis);
  for (const auto* term : {&d.reversal, &d.other_side, &d.compliance, &d.delay, &d.scale})
    EXPECT_FALSE(term->shown) << plain_text(d);
  EXPECT_THAT(plain_text(d), HasSubstr("which neither play nor a spring explains"));
}

TEST(EncoderDifference, ShowsAPitchErrorAsASlope) {
  Rig rig = machine();
  rig.body.spring_frequency_hz = 0.0;
  rig.reading.recorded = Encoder::kLoad;
  rig.reading.lead_slope = 200e-6;
  const EncoderDifference d = found(recorded_by_both(rig));
  expect_term(d.scale, 200e-6 / 1.0002, 0.2e-6);
  EXPECT_FALSE(d.reversal.shown || d.compliance.shown || d.delay.shown);
  EXPECT_THAT(plain_text(d), HasSubstr("pitch error or scale of"));
}

TEST(EncoderDifference, AsksWhetherTheEncodersAreExchanged) {
  Rig rig = machine();
  rig.body.gap = 12e-6;
  SegmentedAxis axis = recorded_by_both(rig);
  std::swap(axis.segments[0].actual, axis.segments[0].actual_motor);
  const EncoderDifference d = found(axis);
  EXPECT_FALSE(d.play().shown);
  EXPECT_THAT(plain_text(d), HasSubstr("exchanged?"));
}

TEST(EncoderDifference, JudgesNoFewMoves) {
  SegmentedAxis axis = recorded_by_both(machine());
  axis.segments = cut(axis.segments, 0.0, 3.0);
  EXPECT_THAT(plain_text(found(axis)), HasSubstr("why is judged from 6 moves on"));
  axis.segments[0].actual_motor.resize(0);
  EXPECT_FALSE(encoder_difference(axis));
  EXPECT_FALSE(encoder_errors(axis.segments));
}

// A rotary axis as its control records it: it goes round at 360 degrees, the motor's encoder has
// another zero and lacks some rows.
TEST(EncoderDifference, IsFoundInARecordingOfARotaryAxisThatGoesRound) {
  Rig rig = machine();
  rig.body.gap = 50e-6;
  const Segment exact = recorded_by_both(rig).segments[0];
  const auto degrees = [](double x) {
    const double turns = (x + 6.25) / (2.0 * std::numbers::pi);
    return text("%.7f", 360.0 * (turns - std::floor(turns)));
  };
  std::string csv = "time[s],C.command[deg],C.actual[deg],C.actual_motor[deg]\n";
  for (Eigen::Index k = 0; k < exact.size(); ++k)
    csv += text("%.3f,", 1e-3 * static_cast<double>(k)) + degrees(exact.command(k)) + ',' +
           degrees(exact.actual(k)) + ',' +
           (k % 1000 < 40 ? "" : degrees(exact.actual_motor(k) + 0.02)) + '\n';
  const test::TemporaryDirectory directory;
  Recording recording = read_recording(directory.file("c.csv", csv));
  EXPECT_THAT(mend_positions(recording),
              Contains(HasSubstr("C.actual_motor: the encoder goes round")));
  const SegmentedAxis axis = segment_axis(recording, "C");
  EXPECT_EQ(axis.segments.size(), 1U);
  EXPECT_GT(axis.report.motor.missing, 100U);
  const EncoderDifference d = found(axis);
  EXPECT_GE(d.moves, 18) << plain_text(d);
  expect_term(d.play(), 50e-6, 1e-7);
  EXPECT_THAT(plain_text(d), HasSubstr("urad"));
  EXPECT_NEAR(d.errors.load_rms, d.errors.motor_rms, 50e-6);
}

}  // namespace
}  // namespace servotwin::hidden_effects
