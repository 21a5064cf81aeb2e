#include "identification/loop/identify.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>

#include "drivers/recordings/recording_file.h"
#include "tests/support/expect_error.h"
#include "tests/support/real_data.h"
#include "tests/virtual_machine/axis.h"
#include "tests/virtual_machine/program.h"
#include "twin/twin.h"
#include "twin/two_pi.h"

namespace servotwin {
namespace {

using test::expect_error;
namespace vm = virtual_machine;

SegmentedAxis as_segments(const vm::AxisRecord& record) {
  SegmentedAxis axis;
  axis.axis = record.name;
  axis.sample_time_s = record.sample_time;
  Segment s;
  s.sample_time_s = record.sample_time;
  s.command = record.command;
  s.actual = record.actual;
  axis.segments = {s};
  return axis;
}

/// An axis of the independent virtual machine with Coulomb friction only.
vm::Axis virtual_axis(bool integrator) {
  vm::Axis axis;
  axis.body.mass = 120.0;
  axis.body.viscous = 400.0;
  axis.body.friction = vm::SaturatedCoulomb{30.0, 1.5e-3};
  axis.drive.rate_hz = 32000.0;
  axis.drive.integration_steps = 4;
  axis.drive.position_gain = 60.0;
  axis.drive.velocity_gain = 120.0 * 180.0;
  axis.drive.integral_gain = integrator ? 120.0 * 180.0 * 50.0 : 0.0;
  axis.recorder.position_step = 0.1e-6;
  return axis;
}

vm::AxisRecord production(const vm::Axis& axis, std::uint64_t seed) {
  vm::MoveMix mix;
  mix.duration = 16.0;
  return vm::record(axis, vm::moves(mix, seed));
}

/// 20 s of a sine of 1 Hz in two segments: until a moment with one amplitude, then with another.
std::vector<Segment> sines(double first, double second, double at_s) {
  constexpr double kStep_s = 1e-3, kDuration_s = 20.0;
  const auto sine = [](double amplitude, double from_s, double to_s) {
    Segment s;
    s.start_s = from_s;
    s.sample_time_s = kStep_s;
    const auto count = static_cast<Eigen::Index>(std::lround((to_s - from_s) / kStep_s));
    s.command = amplitude * (kTwoPi * Eigen::ArrayXd::LinSpaced(count, from_s, to_s)).sin();
    s.actual = s.command;
    return s;
  };
  return {sine(first, 0.0, at_s), sine(second, at_s, kDuration_s)};
}

// Of the squared acceleration, 60 % come before: where the amplitude rises to 1 at 11 s, at
// 11 + 0.6 * 9 = 16.4 s.
TEST(TrainingShare, IsMoreWhereTheAxisHardlyAcceleratesBefore) {
  EXPECT_EQ(training_share_of(sines(1.0, 1.0, 10.0)), 0.6);
  EXPECT_EQ(training_share_of(sines(1.0, 0.01, 11.0)), 0.6);
  EXPECT_NEAR(training_share_of(sines(0.01, 1.0, 11.0)), 16.4 / 20.0, 0.01);
  EXPECT_EQ(training_share_of(sines(0.01, 1.0, 18.0)), 0.85);
  EXPECT_EQ(training_share_of({}), 0.6) << "nothing moves";
  std::vector<Segment> jumps = sines(1.0, 1.0, 10.0);
  jumps[1].command.tail(5'000) += 0.5;  // samples are lost at 15 s
  EXPECT_EQ(training_share_of(jumps), 0.6);
}

class VirtualAxis : public ::testing::TestWithParam<bool> {};

// The truth: the continuous limit of the drive's own gains, known in closed form.
TEST_P(VirtualAxis, PolesFrictionAndStructureAreRecovered) {
  const vm::Axis axis = virtual_axis(GetParam());
  const vm::ContinuousLoop truth = vm::continuous_loop(axis);
  const Identified found = identify(as_segments(production(axis, 3)));
  EXPECT_TRUE(found.refusals.empty());
  EXPECT_TRUE(found.record.excitation.empty()) << found.record.excitation.front();
  const Model& model = found.record.model;
  ASSERT_EQ(model.loop.order, truth.order);
  Loop expected;
  expected.order = truth.order;
  expected.denominator = {truth.a1, truth.a2, truth.a3};
  const PoleSet want = labels_of(expected).set[0], got = labels_of(model.loop).set[0];
  // The sampled drive delays its force by about its period, 31 us, which the continuous limit does
  // not contain.
  EXPECT_NEAR(got.omega, want.omega, 0.02 * want.omega);
  EXPECT_NEAR(got.zeta, want.zeta, 0.03 * want.zeta);
  if (truth.order == 3) {
    EXPECT_NEAR(got.real, want.real, 0.02 * want.real);
  }
  const Effect* friction = model.find(kind_of<CoulombFriction>());
  ASSERT_NE(friction, nullptr);
  EXPECT_NEAR(friction->coefficient[0], 30.0 / 120.0, 0.02 * 0.25);
  EXPECT_EQ(model.command_delay_s(), 0.0);
  EXPECT_LT(found.record.holdout.rms, 0.5e-6);
}

INSTANTIATE_TEST_SUITE_P(Drives, VirtualAxis, ::testing::Bool(), [](const auto& test) {
  return test.param ? "with_integrator" : "without_integrator";
});

// A shift between the streams must be identified as a delay, not as part of the loop.
TEST(Identify, FindsADelayBesideMatchedFeedForward) {
  vm::Axis axis = virtual_axis(true);
  axis.drive.velocity_feedforward = 1.0;
  axis.recorder.delay = 0.0057;
  const Identified found = identify(as_segments(production(axis, 5)));
  EXPECT_NEAR(found.record.model.command_delay_s(), 0.0057, 0.05e-3);
}

TEST(Identify, FindsTheConstantForceOfALoopWithoutIntegrator) {
  vm::Axis axis = virtual_axis(false);
  axis.body.constant_force = 12.0;
  const Identified found = identify(as_segments(production(axis, 7)));
  const Effect* constant = found.record.model.find(kind_of<ConstantForce>());
  ASSERT_NE(constant, nullptr);
  EXPECT_NEAR(constant->coefficient[0], 12.0 / 120.0, 0.002);
}

// The same motion with other noise, many times: the estimates scatter with the stated covariance.
TEST(Identify, TheCovarianceIsThatOfTheScatter) {
  vm::MoveMix mix;
  mix.duration = 6.0;
  SegmentedAxis axis = as_segments(vm::record(virtual_axis(false), vm::moves(mix, 5)));
  Model truth;
  truth.sample_time_s = axis.sample_time_s;
  truth.loop.order = 2;
  truth.loop.denominator = denominator_of({0.0, kTwoPi * 20.0, 0.6}, 2);
  truth.loop.numerator = {1.0, 130.0, 0.0};
  Effect friction = make_effect<CoulombFriction>();
  friction.coefficient[0] = 0.25;
  truth.effects = {friction};
  Segment& segment = axis.segments[0];
  segment.actual.resize(0);
  const Eigen::ArrayXd clean = segment.command - simulate(truth, segment);
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise(0.0, 1e-6);
  IdentifyOptions options;
  options.order = 2;
  options.delay_max_s = 0.0;
  options.training_share = 0.6;  // more would be taken: this axis accelerates most towards the end
  constexpr int kRuns = 30;
  constexpr int kRows[] = {1, 2, 3, 4};  // natural frequency, damping ratio, c0, c1
  Eigen::Matrix4d stated = Eigen::Matrix4d::Zero();
  Eigen::Matrix<double, kRuns, 4> found;
  for (int run = 0; run < kRuns; ++run) {
    segment.actual = clean.unaryExpr([&](double x) { return x + noise(random); });
    const ModelRecord record = identify(axis, options).record;
    ASSERT_TRUE(record.loop_covariance);
    stated += (*record.loop_covariance)(kRows, kRows) / kRuns;
    const PoleSet poles = labels_of(record.model.loop).set[0];
    found.row(run) << poles.omega, poles.zeta, record.model.loop.numerator[0],
        record.model.loop.numerator[1];
  }
  const auto off = (found.rowwise() - found.colwise().mean()).eval();
  const Eigen::Matrix4d scatter = off.transpose() * off / (kRuns - 1);
  const auto correlation = [](const Eigen::Matrix4d& c) -> Eigen::Matrix4d {
    const Eigen::Vector4d unit = c.diagonal().cwiseSqrt().cwiseInverse();
    return unit.asDiagonal() * c * unit.asDiagonal();
  };
  for (int i = 0; i < 4; ++i) {
    EXPECT_LT(scatter(i, i), 2.2 * stated(i, i)) << i;
    EXPECT_GT(scatter(i, i), stated(i, i) / 2.2) << i;
  }
  EXPECT_LT((correlation(scatter) - correlation(stated)).cwiseAbs().maxCoeff(), 0.4);
  EXPECT_GT((correlation(stated) - Eigen::Matrix4d::Identity()).cwiseAbs().maxCoeff(), 0.5);
}

TEST(Identify, TheHoldOutIsNotInTheFit) {
  vm::AxisRecord record = production(virtual_axis(false), 3);
  const IdentifyOptions options;
  const Identified before = identify(as_segments(record), options);
  // Corrupt the held-out data: the model stays the same to the last bit, its held-out figures do
  // not.
  const auto last =
      static_cast<Eigen::Index>(std::ceil(before.record.training_to_s / record.sample_time)) + 1;
  record.actual.tail(record.actual.size() - last) += 50e-6;
  const Identified after = identify(as_segments(record), options);
  EXPECT_EQ(before.record.model.loop.denominator, after.record.model.loop.denominator);
  EXPECT_EQ(before.record.model.loop.numerator, after.record.model.loop.numerator);
  EXPECT_GT(after.record.holdout.rms, 10.0 * before.record.holdout.rms);
}

TEST(Identify, NamesWhatTheMotionDoesNotExcite) {
  // One long move forward at constant speed: no reversal, hardly any acceleration.
  vm::Trajectory trajectory(0.0);
  trajectory.dwell(0.2);
  trajectory.move_to(0.3, vm::Limits{0.03, 0.004, 1.0});
  const Identified found = identify(as_segments(vm::record(virtual_axis(false), trajectory)));
  ASSERT_FALSE(found.record.excitation.empty());
  std::string all;
  for (const std::string& line : found.record.excitation) all += line + "\n";
  EXPECT_NE(all.find("friction is not excited"), std::string::npos) << all;
  EXPECT_NE(all.find("move there and back"), std::string::npos) << all;
  EXPECT_NE(all.find("not excited: accelerations reach"), std::string::npos) << all;
}

TEST(Identify, RefusesWhatCannotBeIdentified) {
  vm::AxisRecord record = production(virtual_axis(false), 3);
  const auto shortened = [&](Eigen::Index n) {
    SegmentedAxis axis = as_segments(record);
    axis.segments = cut(axis.segments, 1.0, 1.0 + 1e-3 * static_cast<double>(n - 1));
    return axis;
  };
  expect_error<std::runtime_error>([&] { (void)identify(shortened(200)); },
                                   {"X", "200 samples", "too few", "record at least"});
  SegmentedAxis still = shortened(2000);
  still.segments[0].actual.setConstant(0.1);
  expect_error<std::runtime_error>([&] { (void)identify(still); }, {"X.actual"});
  SegmentedAxis copied = shortened(2000);
  for (Segment& s : copied.segments) s.actual = s.command;
  expect_error<std::runtime_error>([&] { (void)identify(copied); },
                                   {"X.actual is equal to the command in every sample"});
  IdentifyOptions options;
  options.training_share = 1.5;
  expect_error<std::invalid_argument>([&] { (void)identify(shortened(2000), options); },
                                      {"training share", "1.5"});
  options = {};
  options.bounds.zeta_min = -1.0;
  expect_error<std::invalid_argument>([&] { (void)identify(shortened(2000), options); },
                                      {"damping ratio bounds", "-1"});
}

// Its command and encoder belong to the same instant (examples/README.md): for any part of the
// recording, its velocity lag of 13.3 ms (X) or 9.1 ms (Y) is no delay.
TEST(Identify, AVelocityLagIsNotTakenForADelay) {
  const Recording recording =
      read_recording(std::filesystem::path(SERVOTWIN_SOURCE_DIR) / "examples/axis_production.csv");
  for (const char* name : {"X", "Y"}) {
    for (double to_s : {8.0, 9.0, 12.0, 18.0}) {
      SegmentedAxis axis = segment_axis(recording, name);
      axis.segments = cut(axis.segments, 0.0, to_s);
      const Identified found = identify(axis);
      EXPECT_EQ(found.record.model.command_delay_s(), 0.0) << name << " to " << to_s;
      EXPECT_EQ(found.record.model.loop.order, 3) << name << " to " << to_s;
    }
  }
}

TEST(Identify, EncoderAndCommandExchangedAreRefused) {
  SegmentedAxis axis = segment_axis(
      read_recording(std::filesystem::path(SERVOTWIN_SOURCE_DIR) / "examples/axis_production.csv"),
      "X");
  std::swap(axis.segments[0].command, axis.segments[0].actual);
  const Identified found = identify(axis);
  ASSERT_FALSE(found.refusals.empty());
  EXPECT_NE(found.refusals[0].find("exchanged"), std::string::npos) << found.refusals[0];
}

TEST(Identify, ARecordingThatRestsWhereItIsFittedIsRefused) {
  SegmentedAxis axis = as_segments(production(virtual_axis(false), 3));
  Segment& s = axis.segments[0];
  // Of the training share of 0.6, two thirds are fitted.
  const Eigen::Index rest = s.size() / 2;
  s.command.head(rest).setConstant(s.command(rest));
  s.actual.head(rest).setConstant(s.actual(rest));
  s.start_s = 50'000.0;  // a time of day
  for (const Method method : {Method::kPoleSearch, Method::kJoint}) {
    IdentifyOptions options;
    options.method = method;
    options.training_share = 0.6;
    try {
      (void)identify(axis, options);
      ADD_FAILURE() << "nothing was thrown";
    } catch (const std::runtime_error& error) {
      // As --from counts: from the first row.
      EXPECT_THAT(
          error.what(),
          testing::MatchesRegex(".*the command rests for the first [0-9]+[.]?[0-9]* s.*--from.*"));
    }
  }
}

TEST(Identify, AnEncoderInAnotherUnitIsRefused) {
  SegmentedAxis axis = as_segments(production(virtual_axis(false), 3));
  axis.segments[0].actual *= 0.3;  // as with the wrong pitch of a screw
  const Identified found = identify(axis);
  ASSERT_FALSE(found.refusals.empty());
  EXPECT_NE(found.refusals[0].find("times as far as its command"), std::string::npos)
      << found.refusals[0];
  axis.segments[0].actual *= 1e-3 / 0.3;
  expect_error<std::runtime_error>([&] { (void)identify(axis); },
                                   {"X.actual travels", "is one of them in mm"});
}

Recording real_recording(const std::filesystem::path& file, const char* columns) {
  ReadOptions options;
  options.columns = columns;
  return read_recording(file, options);
}

// Real ball-screw axis (EMPS benchmark). Fitted on the first half, validated on the second in free
// simulation. Published rigid-body parameters with the true control law leave 1.62 um RMS and 10.6
// um MAX (symmetric friction); identification uses command and encoder only.
// An arm that turns a weight: its equation, integrated in steps of 20 us, without the twin.
TEST(Identify, ALoadThatSwingsWithARotaryAxisIsPartOfItsModel) {
  constexpr double kGain = 900.0, kDamping = 50.0, kWeight = 10.0, kFriction = 0.8,
                   kRounding = 2e-3, kStep_s = 4e-3, kFine_s = 2e-5, kNoise = 3e-6;
  SegmentedAxis axis;
  axis.axis = "J";
  axis.rotary = true;
  axis.sample_time_s = kStep_s;
  Segment s;
  s.sample_time_s = kStep_s;
  constexpr Eigen::Index kRows = 5000;
  s.command.resize(kRows);
  s.actual.resize(kRows);
  const auto command = [](double t) {
    return 1.2 * (1.0 - std::cos(kTwoPi * 0.31 * t)) + 0.3 * std::sin(kTwoPi * 0.83 * t);
  };
  std::mt19937_64 random(7);
  std::normal_distribution<double> noise(0.0, kNoise);
  double angle = 0.0, speed = 0.0;
  const auto fine = static_cast<int>(std::lround(kStep_s / kFine_s));
  for (Eigen::Index k = 0; k < kRows; ++k) {
    s.command(k) = command(kStep_s * static_cast<double>(k));
    s.actual(k) = angle + noise(random);
    for (int i = 0; i < fine; ++i) {
      const double t = kStep_s * static_cast<double>(k) + kFine_s * i;
      speed += kFine_s * (kGain * (command(t) - angle) - kDamping * speed -
                          kWeight * std::sin(angle) - kFriction * std::tanh(speed / kRounding));
      angle += kFine_s * speed;
    }
  }
  axis.segments = {s};
  IdentifyOptions options;
  options.method = Method::kJoint;
  const ModelRecord with = identify(axis, options).record;
  const Effect* load = with.model.find(kind_of<SwingingLoad>());
  ASSERT_NE(load, nullptr);
  EXPECT_NEAR(load->coefficient[0], kWeight, 0.02 * kWeight);
  options.beyond_loop = false;
  EXPECT_LT(with.holdout.rms, 0.1 * identify(axis, options).record.holdout.rms);
  // A linear axis has no load that swings.
  axis.rotary = false;
  options.beyond_loop = true;
  EXPECT_EQ(identify(axis, options).record.model.find(kind_of<SwingingLoad>()), nullptr);
}

TEST(RealRecording, EmpsIsPredictedBetterThanByThePublishedModel) {
  SERVOTWIN_REAL_DATA(file, "emps/DATA_EMPS.mat");
  const SegmentedAxis axis =
      segment_axis(real_recording(file, "X.command=qg[m],X.actual=qm[m],X.torque=vir[V]"), "X");
  IdentifyOptions options;
  options.training_share = 0.5;
  const Identified found = identify(axis, options);
  EXPECT_TRUE(found.refusals.empty());
  EXPECT_TRUE(found.record.excitation.empty());
  const Model& model = found.record.model;
  EXPECT_EQ(model.loop.order, 2);  // P position, P velocity control: no integrator
  EXPECT_NE(model.find(kind_of<ConstantForce>()), nullptr);
  EXPECT_EQ(model.find(kind_of<TimeDelay>()), nullptr);
  const PoleSet poles = labels_of(model.loop).set[0];
  EXPECT_NEAR(poles.omega / kTwoPi, 20.6, 0.3);
  EXPECT_NEAR(poles.zeta, 0.362, 0.01);
  EXPECT_LT(found.record.holdout.rms, 1.56e-6);
  EXPECT_LT(found.record.holdout.max, 9.9e-6);
  // Published: Coulomb 20.39 N and offset -3.16 N for 95.1 kg; ours per moved mass, viscous
  // friction in the poles.
  EXPECT_NEAR(model.find(kind_of<ConstantForce>())->coefficient[0] * 95.1, -3.2, 0.8);
  EXPECT_NEAR(model.find(kind_of<CoulombFriction>())->coefficient[0] * 95.1, 22.0, 3.0);
  // Published: 95.1 kg and 35.15 N/V. The torque was not fitted.
  ASSERT_TRUE(found.record.torque);
  EXPECT_EQ(found.record.torque->unit, "V");
  EXPECT_NEAR(found.record.torque->by.scale / (95.1 / 35.15), 1.0, 0.03);
  EXPECT_LT(found.record.torque->holdout_rms, 0.06 * found.record.torque->holdout_scatter);

  // The baseline, full least squares, on the same halves.
  options.method = Method::kFullLs;
  const Identified baseline = identify(axis, options);
  EXPECT_TRUE(!baseline.refusals.empty() ||
              baseline.record.holdout.rms > 2.0 * found.record.holdout.rms);
}

// Real five-axis machine, axis Y1: the encoder record lags the command record by 8.2 ms.
TEST(RealRecording, TheDelayOfTheSinumerikAxisIsFoundAndNotSwallowed) {
  SERVOTWIN_REAL_DATA(file, "sinumerik_edge_5axis/axis_Y1.csv");
  const SegmentedAxis axis = segment_axis(
      real_recording(file, "Y1.command=des_pos[mm],Y1.actual=enc_pos[mm],Y1.torque=torque[Nm]"),
      "Y1");
  ASSERT_EQ(axis.segments.size(), 2U);
  const Identified found = identify(axis);
  EXPECT_NEAR(found.record.model.command_delay_s(), 8.2e-3, 0.1e-3);
  EXPECT_LT(found.record.holdout.rms, 2e-6);  // 9 to 10 um with the shift alone removed
  // The motion has hardly a reversal: friction must be reported as not excited.
  EXPECT_THAT(found.record.excitation, testing::Contains(testing::HasSubstr("friction")));
}

TEST(RealRecording, PolesThatTheRefinementMovedOutOfTheirBoundsAreNamed) {
  SERVOTWIN_REAL_DATA(file, "sinumerik_edge_5axis/axis_Y1.csv");
  const SegmentedAxis axis =
      segment_axis(real_recording(file, "Y1.command=des_pos[mm],Y1.actual=enc_pos[mm]"), "Y1");
  IdentifyOptions options;
  options.method = Method::kJoint;
  const Identified found = identify(axis, options);
  ASSERT_FALSE(inside(found.record.model.loop, PoleBounds{}).has_value());
  EXPECT_THAT(found.record.excitation,
              testing::Contains(testing::HasSubstr("outside of the search bounds (damping")));
}

}  // namespace
}  // namespace servotwin
