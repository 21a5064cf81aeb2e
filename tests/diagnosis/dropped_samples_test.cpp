// Lost samples: held values are counted and interpolated; an axis at rest is not taken for one.
#include "diagnosis/evidence/dropped_samples.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace servotwin {
namespace {

constexpr double kDropStep_s = 1e-3, kEncoderStep = 1e-7;

/// Oscillation over 40 mm with a delay of 5 ms, read by an encoder of 0.1 um with noise.
SegmentedAxis moving() {
  SegmentedAxis axis;
  axis.sample_time_s = kDropStep_s;
  Segment s;
  s.sample_time_s = kDropStep_s;
  s.command.resize(4000);
  s.actual.resize(4000);
  std::mt19937_64 random(1);
  std::normal_distribution<> noise(0.0, 0.3 * kEncoderStep);
  const auto at = [](double t) { return 0.02 * std::sin(2.0 * M_PI * 0.5 * t); };
  for (Eigen::Index k = 0; k < 4000; ++k) {
    const double t = kDropStep_s * static_cast<double>(k);
    s.command(k) = at(t);
    s.actual(k) = std::nearbyint((at(t - 5e-3) + noise(random)) / kEncoderStep) * kEncoderStep;
  }
  axis.segments = {s};
  return axis;
}

TEST(DroppedSamples, NoneWhereEveryValueIsNew) {
  SegmentedAxis axis = moving();
  EXPECT_FALSE(bridge_dropped(axis, kEncoderStep).any(0.0));
}

TEST(DroppedSamples, HeldValuesAreCountedAndBridged) {
  SegmentedAxis axis = moving();
  const Eigen::ArrayXd truth = axis.segments[0].actual;
  for (const auto& [first, count] : {std::pair{700, 1}, {1900, 4}, {3300, 12}}) {
    for (int i = 0; i < count; ++i)
      axis.segments[0].actual(first + i) = axis.segments[0].actual(first - 1);
  }
  const DroppedSamples dropped = bridge_dropped(axis, kEncoderStep);
  EXPECT_EQ(dropped.held, 17U);
  // 12 ms of a sine of 0.5 Hz and 20 mm deviate by x'' t^2 / 8 = 3.6 um from their chord.
  EXPECT_LT((axis.segments[0].actual - truth).abs().maxCoeff(), 4e-6);
}

TEST(DroppedSamples, TwoValuesThatRepeatAreNoneAndThreeAre) {
  SegmentedAxis axis = moving();
  const Segment whole = axis.segments[0];
  for (const int repeats : {2, 3}) {
    axis.segments[0] = whole;
    for (int i = 0; i < repeats; ++i)
      axis.segments[0].actual(1900 + 40 * i) = axis.segments[0].actual(1899 + 40 * i);
    const DroppedSamples dropped = bridge_dropped(axis, kEncoderStep);
    EXPECT_EQ(dropped.held, static_cast<std::size_t>(repeats));
    EXPECT_EQ(dropped.any(kAbsent), repeats > 2);
  }
}

TEST(DroppedSamples, OneValueFarBeyondTheNoiseIsOne) {
  SegmentedAxis axis = moving();
  Segment& s = axis.segments[0];
  const double jump = s.actual(1900) - s.actual(1899);
  s.actual(1900) = s.actual(1899);
  const DroppedSamples dropped = bridge_dropped(axis, kEncoderStep);
  EXPECT_EQ(dropped.held, 1U);
  const double rms = std::abs(jump) / std::sqrt(4000.0);
  EXPECT_NEAR(dropped.held_rms, rms, 0.01 * rms);
  EXPECT_TRUE(dropped.any(0.9 * rms));
  EXPECT_FALSE(dropped.any(1.1 * rms));
}

TEST(DroppedSamples, AnAxisThatSticksIsNone) {
  SegmentedAxis axis = moving();
  Segment& s = axis.segments[0];
  // The axis sticks at the reversal for 30 ms and then follows again, slowly at first.
  for (Eigen::Index k = 505; k < 535; ++k) s.actual(k) = s.actual(505);
  for (Eigen::Index k = 535; k < 600; ++k) {
    const double share = static_cast<double>(k - 534) / 66.0;
    s.actual(k) = s.actual(505) + share * share * (s.actual(600) - s.actual(505));
  }
  EXPECT_EQ(bridge_dropped(axis, kEncoderStep).held, 0U);
}

TEST(DroppedSamples, RowsThatTheReaderBridgedAreReported) {
  SegmentedAxis axis = moving();
  axis.report.samples_bridged = 3;
  axis.report.splits.push_back({1.0, 0.7});
  axis.report.splits.push_back({5.0, 7.7});  // the recorder was stopped and started
  const DroppedSamples dropped = bridge_dropped(axis, kEncoderStep);
  EXPECT_EQ(dropped.missing, 3U);
  EXPECT_EQ(dropped.gaps, 1U);
}

}  // namespace
}  // namespace servotwin
