#include "daemon/record/residual_alarm.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>

#include "identification/loop/identify.h"
#include "tests/virtual_machine/axis.h"
#include "tests/virtual_machine/program.h"
#include "twin/twin.h"

namespace servotwin::daemon {
namespace {

using Kind = AlarmChange::Kind;

constexpr double kRms = 1.5e-6;
constexpr double kDay = 86400.0;

/// Residuals at one cycle per second, so that every cycle is a block. The log of their square has
/// the standard deviation `deviation` around that of kRms and the lag-1 correlation `correlation`.
class Axis {
 public:
  explicit Axis(std::uint64_t seed, double deviation = 0.6, double correlation = 0.0)
      : random_(seed), deviation_(deviation), correlation_(correlation) {}
  LiveResidual next(double growth = 1.0) {
    y_ = correlation_ * y_ + std::sqrt(1.0 - correlation_ * correlation_) * normal_(random_);
    return {growth * kRms * std::exp(0.5 * deviation_ * y_), kRms, version};
  }
  int version = 1;

 private:
  std::mt19937_64 random_;
  std::normal_distribution<> normal_;
  double deviation_, correlation_, y_ = 0.0;
};

/// Feeds the reference, and expects no event before it is complete.
void learn(ResidualAlarm& alarm, Axis& axis, double growth = 1.0) {
  for (int i = 0; i < 899; ++i) EXPECT_FALSE(alarm.add(axis.next(growth)));
  const std::optional<AlarmChange> change = alarm.add(axis.next(growth));
  ASSERT_TRUE(change);
  EXPECT_EQ(change->kind, Kind::kReference);
  EXPECT_FALSE(change->ended);
  EXPECT_EQ(change->motion_s, 900.0);
  EXPECT_TRUE(alarm.watching());
}

TEST(ResidualAlarm, AGrowthIsNoticedWithItsSizeWithinTheTimeOfTheClosedForm) {
  // The deviation of 0.6 is a growth of the RMS by exp(0.3). The reference is at its upper bounds:
  // the deviation at most 1.2 times as large, the mean at most 0.1 deviations higher.
  const double threshold = threshold_for(0.5, 30.0 * kDay);
  double delay = 0.0;
  constexpr int kMachines = 40;
  for (std::uint64_t seed = 0; seed < kMachines; ++seed) {
    ResidualAlarm alarm({}, 1.0);
    Axis axis(seed);
    learn(alarm, axis);
    std::optional<AlarmChange> change;
    while (!change) {
      change = alarm.add(axis.next(std::exp(0.6)));
      ++delay;
    }
    EXPECT_EQ(change->kind, Kind::kRaised);
    EXPECT_EQ(change->threshold, threshold);
    EXPECT_TRUE(alarm.raised());
    // RMS of a lognormal: exp(deviation^2 / 4) times its median's.
    EXPECT_NEAR(change->reference_rms / (kRms * std::exp(0.09)), 1.0, 0.2);
    EXPECT_NEAR(change->rms / change->reference_rms, std::exp(0.6), 0.8);
  }
  EXPECT_GT(delay / kMachines, average_run_length(0.5, threshold, 2.0));
  EXPECT_LT(delay / kMachines, average_run_length(0.5, threshold, 2.0 / 1.2 - 0.1));
}

// Runs are about exponential: at the stated rate one machine in ten has a false alarm within a
// tenth of the stated time. With a reference of 15 minutes and any correlation of the seconds.
class FalseAlarms : public testing::TestWithParam<double> {};

TEST_P(FalseAlarms, AreAsRareAsStatedAlthoughTheReferenceIsEstimated) {
  constexpr double kStated = 1e6;
  constexpr int kMachines = 100;
  int early = 0;
  for (std::uint64_t seed = 0; seed < kMachines; ++seed) {
    ResidualAlarm alarm({.false_alarm_s = kStated}, 1.0);
    Axis axis(seed, 0.6, GetParam());
    learn(alarm, axis);
    int run = 0;
    while (run < static_cast<int>(0.1 * kStated) && !alarm.add(axis.next())) ++run;
    if (run < static_cast<int>(0.1 * kStated)) ++early;
  }
  EXPECT_LE(early, kMachines / 10);
}
INSTANTIATE_TEST_SUITE_P(Correlation, FalseAlarms, testing::Values(0.0, 0.5, 0.8));

TEST(ResidualAlarm, WithoutAllowingForCorrelationTheyWouldNotBe) {
  // Without the two precautions: the same sequence with its plain deviation and without bounds.
  constexpr double kStated = 3000.0;
  double total = 0.0;
  for (std::uint64_t seed = 0; seed < 100; ++seed) {
    Axis axis(seed, 1.0, 0.5);
    Cusum cusum(0.5, threshold_for(0.5, kStated));
    int run = 0;
    while (run < 20 * static_cast<int>(kStated) &&
           !cusum.add(2.0 * std::log(axis.next().residual / kRms)))
      ++run;
    total += run;
  }
  EXPECT_LT(total / 100, 0.3 * kStated);
}

TEST(ResidualAlarm, AGrowthOfAFewPercentIsNoneEvenWhereEverySecondIsAlike) {
  ResidualAlarm alarm({}, 1.0);
  Axis axis(20, 0.01);
  learn(alarm, axis);
  for (int i = 0; i < 20'000; ++i) EXPECT_FALSE(alarm.add(axis.next(1.05)));
  int delay = 1;
  while (!alarm.add(axis.next(1.3))) ASSERT_LT(++delay, 100);
}

TEST(ResidualAlarm, OneSecondHoweverBadIsNoAlarm) {
  ResidualAlarm alarm({}, 1.0);
  Axis axis(20);
  learn(alarm, axis);
  EXPECT_FALSE(alarm.add({1.0, kRms, 1}));
  for (int i = 0; i < 100; ++i) EXPECT_FALSE(alarm.add(axis.next()));
}

TEST(ResidualAlarm, IsOverWhenTheResidualIsBack) {
  ResidualAlarm alarm({}, 1.0);
  Axis axis(20);
  learn(alarm, axis);
  for (int i = 0; i < 500; ++i) (void)alarm.add(axis.next(4.0));
  ASSERT_TRUE(alarm.raised());
  std::optional<AlarmChange> change;
  int delay = 0;
  while (!change) {
    change = alarm.add(axis.next());
    ASSERT_LT(++delay, 100);
  }
  EXPECT_EQ(change->kind, Kind::kBack);
  EXPECT_FALSE(alarm.raised());
}

TEST(ResidualAlarm, AModelThatIsFarFromItsHoldoutIsNotTakenForNormal) {
  ResidualAlarm alarm({}, 1.0);
  Axis axis(20);
  learn(alarm, axis, 4.0);
  int delay = 1;
  while (!alarm.add(axis.next(4.0))) ASSERT_LT(++delay, 100);
}

TEST(ResidualAlarm, AGrowthIsNotHiddenByANewModel) {
  ResidualAlarm alarm({}, 1.0);
  Axis axis(20);
  learn(alarm, axis);
  axis.version = 2;  // has taken up half of what has grown
  int delay = 1;
  while (!alarm.add(axis.next(1.7))) ASSERT_LT(++delay, 300);
  // Then the reference of the new model applies, and the alarm is over.
  std::optional<AlarmChange> change;
  while (!change) {
    change = alarm.add(axis.next(1.7));
    ASSERT_LT(++delay, 902);
  }
  EXPECT_EQ(change->kind, Kind::kReference);
  EXPECT_TRUE(change->ended);
  EXPECT_EQ(delay, 900);
  EXPECT_FALSE(alarm.raised());
  EXPECT_NEAR(change->reference_rms / (1.7 * kRms * std::exp(0.09)), 1.0, 0.1);
  for (int i = 0; i < 2000; ++i) EXPECT_FALSE(alarm.add(axis.next(1.7)));
}

TEST(ResidualAlarm, ABetterModelIsWatchedByItsOwnReference) {
  ResidualAlarm alarm({}, 1.0);
  Axis axis(20);
  learn(alarm, axis);
  axis.version = 2;
  learn(alarm, axis, 0.3);
  int delay = 1;
  while (!alarm.add(axis.next(0.8))) ASSERT_LT(++delay, 100) << "less than the first model left";
}

TEST(ResidualAlarm, APieceIsASecondOfMotionOfOneModel) {
  // 1 kHz: the reference is complete after 60'000 cycles that count, whatever comes in between.
  ResidualAlarm alarm({.reference_s = 60.0}, 1e-3);
  const auto feed = [&](int cycles, int version) {
    for (int i = 0; i < cycles; ++i) EXPECT_FALSE(alarm.add({kRms, kRms, version}));
  };
  feed(59'999, 1);
  for (const double bad : {std::nan(""), std::numeric_limits<double>::infinity()})
    EXPECT_FALSE(alarm.add({bad, kRms, 1}));
  EXPECT_FALSE(alarm.add({kRms, kRms, 0})) << "no model";
  EXPECT_FALSE(alarm.watching());
  feed(59'999, 2);
  EXPECT_FALSE(alarm.watching()) << "what another model left is not this one's";
  EXPECT_TRUE(alarm.add({kRms, kRms, 2}));
  EXPECT_TRUE(alarm.watching());
}

TEST(ResidualAlarm, AResidualOfNothingIsNoTrouble) {
  ResidualAlarm alarm({.reference_s = 60.0}, 1.0);
  for (int i = 0; i < 200; ++i) EXPECT_EQ(alarm.add({0.0, 0.0, 1}).has_value(), i == 59);
  EXPECT_TRUE(alarm.watching());
  int delay = 1;
  while (!alarm.add({kRms, 0.0, 1})) ASSERT_LT(++delay, 20);
}

/// Production-like moves of a ball-screw axis with this much friction that slides after 60 um, from
/// code that shares nothing with the twin.
Segment moves(double seconds, double friction, std::uint64_t seed) {
  namespace vm = virtual_machine;
  vm::Axis axis;
  axis.body.mass = 100.0;
  axis.body.viscous = 240.0;
  axis.body.friction = vm::gms_with_curve(friction, 60e-6, 3.0, 10);
  axis.drive.position_gain = 60.0;
  axis.drive.velocity_gain = 20'000.0;
  axis.recorder.position_step = 1e-7;
  vm::MoveMix mix;
  mix.duration = seconds;
  const vm::AxisRecord record = vm::record(axis, vm::moves(mix, seed));
  Segment out;
  out.sample_time_s = record.sample_time;
  out.command = record.command;
  out.actual = record.actual;
  return out;
}

TEST(LongResidualAlarm, FrictionThatHasGrownByATenthIsNoticedOnAMachineOfOtherCode) {
  SegmentedAxis seen;
  seen.axis = "X";
  seen.sample_time_s = 1e-3;
  seen.segments = {moves(24.0, 60.0, 1)};
  IdentifyOptions options;
  options.method = Method::kJoint;
  options.order = 2;
  options.delay_max_s = 0.0;
  options.friction = kind_of<Presliding>();
  const ModelRecord record = identify(seen, options).record;
  ResidualAlarm alarm({.reference_s = 120.0}, 1e-3);
  const auto feed = [&](const Segment& segment) {
    const Eigen::ArrayXd left = segment.command - segment.actual - simulate(record.model, segment);
    int motion = 0;
    for (Eigen::Index i = 1; i < left.size(); ++i) {
      if (segment.command(i) == segment.command(i - 1)) continue;
      ++motion;
      const auto change = alarm.add({left(i), record.holdout.rms, 1});
      if (change && change->kind == Kind::kRaised) return motion * 1e-3;
    }
    return kAbsent;
  };
  EXPECT_TRUE(std::isnan(feed(moves(240.0, 60.0, 2))));
  ASSERT_TRUE(alarm.watching());
  EXPECT_LT(feed(moves(60.0, 66.0, 3)), 30.0) << "seconds of motion";
}

TEST(ResidualAlarm, OptionsThatMakeNoSenseAreRefused) {
  EXPECT_THROW(ResidualAlarm({}, 0.0), std::invalid_argument);
  EXPECT_THROW(ResidualAlarm({.false_alarm_s = 0.0}, 1e-3), std::invalid_argument);
  EXPECT_THROW(ResidualAlarm({.reference_s = 59.0}, 1e-3), std::invalid_argument);
}

}  // namespace
}  // namespace servotwin::daemon
