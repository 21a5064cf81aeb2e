// Stamps that repeat, are coarse, wrong, run backwards or jitter: the segments are those of the
// motion.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>

#include "identification/recording/segments.h"
#include "tests/identification/sampled_motion.h"
#include "tests/support/expect_error.h"

namespace servotwin {
namespace {

using test::expect_error;

// Repeats.

TEST(Stamps, RepeatedRowsAreDroppedAndCounted) {
  Recording r = sampled(grid(1000, 0.001));
  for (const std::size_t row : {900, 500, 500, 20}) repeat_row(r, row);
  const SegmentedAxis axis = segment_axis(r, "X");
  EXPECT_EQ(axis.report.repeated, 4U);
  ASSERT_EQ(axis.segments.size(), 1U);
  EXPECT_EQ(axis.segments[0].size(), 1000);
  EXPECT_EQ(axis.sample_time_s, 0.001);
  expect_motion(axis.segments[0], 0.0, 1e-12);
  expect_accounts_to_balance(axis.report);
  says(axis.report, "4 rows dropped: the stamp of the row before was repeated");
}

// A recorder that asks faster than the drive answers writes every third value twice, at regular
// places.
TEST(Stamps, ARegularPatternOfCopiesIsNoFinerRate) {
  Recording r = sampled(grid(3000, 0.001));
  for (std::size_t row = 2999; row > 3; row -= 3) repeat_row(r, row);
  const SegmentedAxis axis = segment_axis(r, "X");
  EXPECT_EQ(axis.sample_time_s, 0.001);
  EXPECT_EQ(axis.report.repeated, 999U);
  EXPECT_EQ(axis.segments.at(0).size(), 3000);
  expect_motion(axis.segments[0], 0.0, 1e-12);
}

// Rows too many, with values of their own: no even grid is behind such stamps, although they are
// coarse.
TEST(Stamps, ExtraRowsAtRandomPlacesAreNoFinerRate) {
  std::mt19937_64 random(6);
  std::vector<double> at, stamps;
  for (const double t : grid(3000, 0.001)) {
    at.push_back(t);
    stamps.push_back(t);
    if (random() % 20 != 0) continue;
    at.push_back(t + 0.4e-3);
    stamps.push_back(t);
  }
  const SegmentedAxis axis = segment_axis(sampled(at, stamps), "X");
  EXPECT_EQ(axis.sample_time_s, 0.001);
  EXPECT_EQ(axis.report.repeated, at.size() - 3000);
  EXPECT_EQ(axis.segments.at(0).size(), 3000);
  expect_motion(axis.segments[0], 0.0, 1e-12);
}

TEST(Stamps, AStampThatRepeatsTheOneBeforeAndLeavesAHoleIsRepaired) {
  const std::vector<double> at = grid(1000, 0.001);
  for (const std::ptrdiff_t wrong_by : {-1, 1}) {
    std::vector<double> stamps = at;
    stamps[400] = at[static_cast<std::size_t>(400 + wrong_by)];
    const SegmentedAxis axis = segment_axis(sampled(at, stamps), "X");
    EXPECT_EQ(axis.report.repaired, 1U);
    EXPECT_EQ(axis.report.repeated, 0U);
    ASSERT_EQ(axis.segments.size(), 1U);
    expect_motion(axis.segments[0], 0.0, 1e-12);
  }
}

// Coarse stamps.

class CoarseStamps : public testing::TestWithParam<double> {};

TEST_P(CoarseStamps, GiveTheTrueRate) {
  const double step = GetParam();
  const std::vector<double> at = grid(6000, step);
  for (const double offset : {0.0, 0.4e-3, 1.7e9}) {
    std::vector<double> stamps;
    for (const double t : at) stamps.push_back(std::floor((t + offset) * 1e3) / 1e3);
    const SegmentedAxis axis = segment_axis(sampled(at, stamps), "X");
    EXPECT_NEAR(axis.sample_time_s, step, 2e-4 * step);
    ASSERT_EQ(axis.segments.size(), 1U) << text_of(axis.report);
    EXPECT_EQ(axis.segments[0].size(), 6000);
    EXPECT_EQ(axis.report.used_rows, 6000U);
    EXPECT_EQ(axis.report.repeated, 0U);
    for (Eigen::Index k = 0; k < 6000; ++k) {
      ASSERT_EQ(axis.segments[0].command[k], command_at(at[static_cast<std::size_t>(k)]));
    }
  }
}
INSTANTIATE_TEST_SUITE_P(Steps, CoarseStamps,
                         testing::Values(0.05e-3, 0.125e-3, 0.6e-3, 0.99e-3, 1.005e-3, 1.6e-3,
                                         2.5e-3, 2.56e-3));

TEST(Stamps, CoarseStampsPlaceTheRowsBehindAGap) {
  constexpr double kStep = 0.6e-3;
  std::vector<double> at = grid(6000, kStep), stamps;
  at.erase(at.begin() + 2000, at.begin() + 2006);  // six: bridged, 5 ms hold eight
  at.erase(at.begin() + 4000, at.begin() + 4500);
  for (const double t : at) stamps.push_back(std::round(t * 1e3) / 1e3);
  const SegmentedAxis axis = segment_axis(sampled(at, stamps), "X");
  ASSERT_EQ(axis.segments.size(), 2U) << text_of(axis.report);
  EXPECT_EQ(axis.report.samples_bridged, 6U);
  EXPECT_EQ(axis.segments[0].size(), 4006);
  EXPECT_EQ(axis.segments[1].size(), 1494);
  EXPECT_EQ(axis.segments[0].command[4005], command_at(4005 * kStep));
  says(axis.report, "stamps are only written to 1 ms");
}

// Wrong stamps, and time that runs backwards.

struct WrongStamp {
  const char* name;
  std::size_t row;
  double stamp;
};
class OneWrongStamp : public testing::TestWithParam<WrongStamp> {};

TEST_P(OneWrongStamp, IsRepairedAndReported) {
  const std::vector<double> at = grid(1000, 0.001);
  std::vector<double> stamps = at;
  stamps[GetParam().row] = GetParam().stamp;
  const SegmentedAxis axis = segment_axis(sampled(at, stamps), "X");
  EXPECT_EQ(axis.report.repaired, 1U);
  ASSERT_EQ(axis.segments.size(), 1U) << text_of(axis.report);
  EXPECT_EQ(axis.segments[0].size(), 1000);
  expect_motion(axis.segments[0], axis.segments[0].start_s, 1e-12);
  EXPECT_NEAR(axis.segments[0].start_s, 0.0, 1e-12);
  says(axis.report, "1 wrong stamp replaced");
}
INSTANTIATE_TEST_SUITE_P(
    Rows, OneWrongStamp,
    testing::Values(WrongStamp{"low", 500, 0.0}, WrongStamp{"high", 500, 1e6},
                    WrongStamp{"negative", 500, -7.0}, WrongStamp{"a_little_low", 500, 0.4985},
                    WrongStamp{"nan", 500, kAbsent}, WrongStamp{"infinite", 500, HUGE_VAL},
                    WrongStamp{"second", 1, -3.0}, WrongStamp{"first", 0, 5.0},
                    WrongStamp{"last", 999, 0.0}, WrongStamp{"last_but_one", 998, 77.0}),
    [](const auto& about) { return std::string(about.param.name); });

TEST(Stamps, AWrongStampBesideAGapLosesItsRowOnly) {
  for (const double wrong : {0.0, 1e6}) {
    Recording r = sampled(grid(1000, 0.001));
    erase_rows(r, 500, 3);
    r.time[500] = wrong;
    const SegmentedAxis axis = segment_axis(r, "X");
    EXPECT_EQ(axis.report.unplaced, 1U);
    ASSERT_EQ(axis.segments.size(), 1U);
    EXPECT_EQ(axis.segments[0].size(), 1000);
    expect_motion(axis.segments[0], 0.0, 2e-5);
    expect_accounts_to_balance(axis.report);
    says(axis.report, "1 row dropped: no usable stamp");
  }
}

TEST(Stamps, TimeRunningBackwardsIsRefusedWithRowAndStamps) {
  const std::vector<double> at = grid(1000, 0.001);
  const auto refuses = [&](const std::vector<double>& stamps,
                           std::initializer_list<const char*> parts) {
    expect_error<std::runtime_error>([&] { (void)segment_axis(sampled(at, stamps), "X"); }, parts);
  };
  std::vector<double> reset = at;  // the clock starts again
  for (std::size_t i = 600; i < 1000; ++i) reset[i] -= 0.6;
  refuses(reset, {"rec.csv", "backwards at row 601", "0 s after 0.599 s", "split the file"});
  std::vector<double> set_back = at;  // the clock is corrected by one and a half steps
  for (std::size_t i = 600; i < 1000; ++i) set_back[i] -= 0.0015;
  refuses(set_back, {"backwards at row 601", "0.5985 s after 0.599 s"});
  std::vector<double> swapped = at;
  std::swap(swapped[300], swapped[301]);
  refuses(swapped, {"backwards at row 302", "0.3 s after 0.301 s"});
  std::vector<double> reversed(at.rbegin(), at.rend());
  refuses(reversed, {"backwards at row 2", "0.998 s after 0.999 s"});
  std::vector<double> many = at;  // no accident any more
  for (std::size_t i = 10; i < 1000; i += 20) many[i] = 0.0;
  refuses(many, {"backwards at row"});
}

// Jitter.

TEST(Stamps, SmallJitterIsTheRecordersAndTheSamplesAreEven) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> jitter(-0.04e-3, 0.04e-3);
  const std::vector<double> at = grid(5000, 0.001);
  std::vector<double> stamps = at;
  for (double& t : stamps) t += jitter(random);
  const SegmentedAxis axis = segment_axis(sampled(at, stamps), "X");
  EXPECT_EQ(axis.report.spacing, Spacing::kEven);
  EXPECT_EQ(axis.sample_time_s, 0.001);
  ASSERT_EQ(axis.segments.size(), 1U);
  expect_motion(axis.segments[0], 0.0, 1e-12);
  // Two independent errors of +-4 % per step: 0.04 * sqrt(2/3) rms and 0.08 at most.
  EXPECT_NEAR(axis.report.jitter_rms, 0.0327, 0.001);
  EXPECT_GT(axis.report.jitter_max, 0.07);
  EXPECT_LE(axis.report.jitter_max, 0.08);
  says(axis.report, "samples treated as evenly spaced");
}

TEST(Stamps, AFewLateStampsAddNoSamples) {
  const std::vector<double> at = grid(5000, 0.001);
  std::vector<double> stamps = at;
  for (const std::size_t i : {100, 2000, 3000}) stamps[i] += 0.6e-3;
  const SegmentedAxis axis = segment_axis(sampled(at, stamps), "X");
  ASSERT_EQ(axis.segments.size(), 1U);
  EXPECT_EQ(axis.segments[0].size(), 5000);
  expect_motion(axis.segments[0], 0.0, 1e-12);
}

TEST(Stamps, LargeJitterIsResampledOntoTheMedianStepAndSaysSo) {
  std::mt19937_64 random(4);
  std::uniform_real_distribution<double> step(0.7e-3, 1.3e-3);
  std::vector<double> at{2.0};
  while (at.size() < 5000) at.push_back(at.back() + step(random));
  const SegmentedAxis axis = segment_axis(sampled(at), "X");
  EXPECT_EQ(axis.report.spacing, Spacing::kUneven);
  EXPECT_NEAR(axis.sample_time_s, 0.001, 0.02e-3);
  ASSERT_EQ(axis.segments.size(), 1U);
  EXPECT_EQ(axis.segments[0].start_s, 2.0);
  EXPECT_NEAR(axis.segments[0].end_s(), at.back(), axis.sample_time_s);
  // Linear interpolation of the sine: curvature 4.9, 1.3 ms at most, 4.9 h^2 / 8.
  expect_motion(axis.segments[0], 2.0, 1.1e-6);
  says(axis.report, "resampled linearly onto a grid of");
}

TEST(Stamps, LargeJitterKeepsItsGaps) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> step(0.7e-3, 1.3e-3);
  std::vector<double> at{0.0};
  while (at.size() < 5000) {
    at.push_back(at.back() + step(random) + (at.size() == 2500 ? 0.05 : 0.0));
  }
  Recording r = sampled(at);
  r.axes[0].actual[1000] = kAbsent;
  const SegmentedAxis axis = segment_axis(r, "X");
  ASSERT_EQ(axis.segments.size(), 2U);
  EXPECT_EQ(axis.segments[1].start_s, at[2500]);
  expect_motion(axis.segments[0], 0.0, 5e-6);
  expect_motion(axis.segments[1], at[2500], 5e-6);
  expect_accounts_to_balance(axis.report);
}

// A clock that is a hundred ppm fast gives its own step, not the round one.
TEST(Stamps, OnlyWhatIsWithinAClocksErrorIsRounded) {
  EXPECT_EQ(segment_axis(sampled(grid(2000, 1.0 / 1024 * (1 + 5e-6))), "X").sample_time_s,
            1.0 / 1024);
  EXPECT_EQ(segment_axis(sampled(grid(2000, 0.002263 * (1 + 5e-6))), "X").sample_time_s, 0.002263);
  EXPECT_NEAR(segment_axis(sampled(grid(2000, 0.0010001)), "X").sample_time_s, 0.0010001, 1e-12);
}

}  // namespace
}  // namespace servotwin
