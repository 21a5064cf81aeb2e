#include "identification/segments.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <string>

#include "drivers/recording_file.h"
#include "tests/support/expect_error.h"
#include "tests/support/real_data.h"

namespace servotwin {
namespace {

using test::expect_error;

double command_at(double t) { return 0.1 * std::sin(7.0 * t) + 0.02 * t; }
double actual_at(double t) { return command_at(t - 0.004); }
double torque_at(double t) { return 3.0 * std::cos(7.0 * t); }

/// A motion sampled at `at`, and stamped as `stamps` says.
Recording sampled(const std::vector<double>& at, const std::vector<double>& stamps) {
  Recording r;
  r.source = "rec.csv";
  r.time = stamps;
  AxisRecord x;
  x.name = "X";
  x.torque_unit = "Nm";
  for (const double t : at) {
    x.command.push_back(command_at(t));
    x.actual.push_back(actual_at(t));
    x.torque.push_back(torque_at(t));
  }
  r.axes.push_back(std::move(x));
  return r;
}
Recording sampled(const std::vector<double>& at) { return sampled(at, at); }

std::vector<double> grid(std::size_t rows, double step) {
  std::vector<double> times(rows);
  for (std::size_t i = 0; i < rows; ++i) times[i] = static_cast<double>(i) * step;
  return times;
}

void erase_rows(Recording& r, std::size_t from, std::size_t count) {
  const auto erase = [&](std::vector<double>& values) {
    const auto begin = values.begin() + static_cast<std::ptrdiff_t>(from);
    values.erase(begin, begin + static_cast<std::ptrdiff_t>(count));
  };
  erase(r.time);
  for (AxisRecord& axis : r.axes) {
    for (auto* values : {&axis.command, &axis.actual, &axis.torque}) erase(*values);
  }
}

void repeat_row(Recording& r, std::size_t row) {
  const auto repeat = [&](std::vector<double>& values) {
    values.insert(values.begin() + static_cast<std::ptrdiff_t>(row), values[row]);
  };
  repeat(r.time);
  for (AxisRecord& axis : r.axes) {
    for (auto* values : {&axis.command, &axis.actual, &axis.torque}) repeat(*values);
  }
}

std::string text_of(const SegmentReport& report) {
  std::string text;
  for (const std::string& line : report.lines()) text += line + "\n";
  return text;
}
void says(const SegmentReport& report, const char* part) {
  EXPECT_NE(text_of(report).find(part), std::string::npos) << "no \"" << part << "\" in:\n"
                                                           << text_of(report);
}

/// Every row is in exactly one of the report's accounts.
void expect_accounts_to_balance(const SegmentReport& r) {
  EXPECT_EQ(r.used_rows + r.nan_bridged + r.nan_dropped + r.repeated + r.unplaced + r.short_rows,
            r.rows);
}

/// The segment holds the motion's own values from `first_s` on, to within `tolerance`.
void expect_motion(const Segment& segment, double first_s, double tolerance) {
  for (Eigen::Index k = 0; k < segment.size(); ++k) {
    const double t = first_s + static_cast<double>(k) * segment.sample_time_s;
    ASSERT_NEAR(segment.command[k], command_at(t), tolerance) << "sample " << k;
    ASSERT_NEAR(segment.actual[k], actual_at(t), tolerance) << "sample " << k;
    ASSERT_NEAR(segment.torque[k], torque_at(t), 30 * tolerance) << "sample " << k;
  }
}

TEST(Segments, AnEvenRecordingIsOneSegmentWithItsOwnValues) {
  const SegmentedAxis axis = segment_axis(sampled(grid(2000, 0.001)), "X");
  ASSERT_EQ(axis.segments.size(), 1U);
  EXPECT_EQ(axis.sample_time_s, 0.001);
  EXPECT_EQ(axis.segments[0].size(), 2000);
  EXPECT_EQ(axis.segments[0].start_s, 0.0);
  expect_motion(axis.segments[0], 0.0, 1e-12);
  EXPECT_EQ(axis.torque_unit, "Nm");
  EXPECT_EQ(axis.report.used_rows, 2000U);
  says(axis.report, "2000 rows over 1.999 s, 2000 used, step 1 ms (1000 Hz)");
  EXPECT_EQ(axis.report.lines().size(), 2U) << text_of(axis.report);
}

TEST(Segments, WithoutEncoderAndTorqueTheyAreEmpty) {
  Recording r = sampled(grid(50, 0.001));
  r.axes[0].actual.assign(50, kAbsent);
  r.axes[0].torque.clear();
  const SegmentedAxis axis = segment_axis(r, "X");
  EXPECT_EQ(axis.segments.at(0).size(), 50);
  EXPECT_EQ(axis.segments[0].actual.size(), 0);
  EXPECT_EQ(axis.segments[0].torque.size(), 0);
  EXPECT_EQ(axis.torque_unit, "");
}

// Gaps.

struct GapCase {
  double step;
  std::size_t missing;
  bool bridged;
};
class Gap : public testing::TestWithParam<GapCase> {};

TEST_P(Gap, IsBridgedUpToTheLimitAndSplitBeyondIt) {
  const auto [step, missing, bridged] = GetParam();
  Recording r = sampled(grid(400, step));
  // A straight motion, over which linear interpolation is exact.
  for (auto* values : {&r.axes[0].command, &r.axes[0].actual, &r.axes[0].torque}) {
    for (std::size_t i = 0; i < values->size(); ++i) (*values)[i] = 0.25 * static_cast<double>(i);
  }
  erase_rows(r, 150, missing);
  const SegmentedAxis axis = segment_axis(r, "X");
  const double length = static_cast<double>(missing + 1) * step;
  expect_accounts_to_balance(axis.report);
  if (bridged) {
    ASSERT_EQ(axis.segments.size(), 1U);
    ASSERT_EQ(axis.segments[0].size(), 400);
    for (Eigen::Index k = 0; k < 400; ++k) {
      ASSERT_DOUBLE_EQ(axis.segments[0].actual[k], 0.25 * static_cast<double>(k));
    }
    EXPECT_EQ(axis.report.gaps_bridged, 1U);
    EXPECT_EQ(axis.report.samples_bridged, missing);
    EXPECT_NEAR(axis.report.longest_bridged_s, length, 1e-9);
    says(axis.report, "bridged 1 gap by linear interpolation");
  } else {
    ASSERT_EQ(axis.segments.size(), 2U);
    EXPECT_EQ(axis.segments[0].size(), 150);
    EXPECT_EQ(axis.segments[1].size(), static_cast<Eigen::Index>(250 - missing));
    EXPECT_NEAR(axis.segments[1].start_s, static_cast<double>(150 + missing) * step, 1e-12);
    ASSERT_EQ(axis.report.splits.size(), 1U);
    EXPECT_NEAR(axis.report.splits[0].time_s, 149 * step, 1e-12);
    EXPECT_NEAR(axis.report.splits[0].length_s, length, 1e-9);
    EXPECT_EQ(axis.report.gaps_bridged, 0U);
    says(axis.report, "split at");
  }
}

// Five milliseconds of samples, and three samples in any case.
INSTANTIATE_TEST_SUITE_P(Limits, Gap,
                         testing::Values(GapCase{0.001, 1, true}, GapCase{0.001, 5, true},
                                         GapCase{0.001, 6, false}, GapCase{0.000125, 40, true},
                                         GapCase{0.000125, 41, false}, GapCase{0.01, 3, true},
                                         GapCase{0.01, 4, false}, GapCase{0.01, 200, false}));

TEST(Segments, AStretchTooShortIsDroppedAndNamed) {
  Recording r = sampled(grid(400, 0.001));
  erase_rows(r, 200, 50);
  erase_rows(r, 207, 50);
  const SegmentedAxis axis = segment_axis(r, "X");
  ASSERT_EQ(axis.segments.size(), 2U);
  EXPECT_EQ(axis.report.short_rows, 7U);
  expect_accounts_to_balance(axis.report);
  says(axis.report, "dropped 7 rows in 1 too short");
}

// Values that are missing.

TEST(Segments, RowsWithoutAValueAreAGap) {
  Recording r = sampled(grid(1000, 0.001));
  auto& x = r.axes[0];
  x.command[0] = kAbsent;                                                // at the beginning
  x.actual[300] = x.actual[301] = HUGE_VAL;                              // short
  std::fill(x.command.begin() + 500, x.command.begin() + 506, kAbsent);  // long
  x.actual[999] = kAbsent;                                               // at the end
  const SegmentedAxis axis = segment_axis(r, "X");
  ASSERT_EQ(axis.segments.size(), 2U);
  EXPECT_EQ(axis.segments[0].start_s, 0.001);
  EXPECT_EQ(axis.segments[0].size(), 499);
  EXPECT_EQ(axis.segments[1].size(), 493);
  EXPECT_NEAR(axis.segments[1].start_s, 0.506, 1e-12);
  EXPECT_EQ(axis.report.nan_bridged, 2U);
  EXPECT_EQ(axis.report.nan_dropped, 8U);
  expect_accounts_to_balance(axis.report);
  // The sine's curvature over three steps, 0.1 * 49 * (0.003)^2 / 8.
  expect_motion(axis.segments[0], 0.001, 6e-6);
  says(axis.report, "2 rows without a value bridged");
  says(axis.report, "8 rows without a value dropped");
}

TEST(Segments, AMissingRowNextToAMissingValueIsOneGap) {
  Recording r = sampled(grid(1000, 0.001));
  r.axes[0].actual[499] = kAbsent;
  erase_rows(r, 500, 5);
  const SegmentedAxis axis = segment_axis(r, "X");
  EXPECT_EQ(axis.segments.size(), 2U) << "six in a row are missing, which is over the limit";
  EXPECT_NEAR(axis.report.splits.at(0).length_s, 0.007, 1e-9);
}

TEST(Segments, AMissingTorqueSplitsNothing) {
  Recording r = sampled(grid(1000, 0.001));
  auto& torque = r.axes[0].torque;
  for (const std::size_t i : {0, 100, 101, 102}) torque[i] = kAbsent;
  std::fill(torque.begin() + 500, torque.begin() + 520, kAbsent);
  const SegmentedAxis axis = segment_axis(r, "X");
  ASSERT_EQ(axis.segments.size(), 1U);
  const Eigen::ArrayXd& filled = axis.segments[0].torque;
  EXPECT_NEAR(filled[101], torque_at(0.101), 1e-3);
  EXPECT_TRUE(std::isnan(filled[0]) && std::isnan(filled[500]) && std::isnan(filled[519]));
  EXPECT_EQ(filled.isNaN().count(), 21);
  EXPECT_EQ(axis.report.torque_bridged, 3U);
  EXPECT_EQ(axis.report.torque_missing, 21U);
  says(axis.report, "21 torque values missing");
}

// Repeats.

TEST(Segments, RepeatedRowsAreDroppedAndCounted) {
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
TEST(Segments, ARegularPatternOfCopiesIsNoFinerRate) {
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
TEST(Segments, ExtraRowsAtRandomPlacesAreNoFinerRate) {
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

TEST(Segments, AStampThatRepeatsTheOneBeforeAndLeavesAHoleIsRepaired) {
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

TEST(Segments, CoarseStampsPlaceTheRowsBehindAGap) {
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

TEST(Segments, AWrongStampBesideAGapLosesItsRowOnly) {
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

TEST(Segments, TimeRunningBackwardsIsRefusedWithRowAndStamps) {
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

TEST(Segments, SmallJitterIsTheRecordersAndTheSamplesAreEven) {
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
  says(axis.report, "samples taken as evenly spaced");
}

TEST(Segments, AFewLateStampsAddNoSamples) {
  const std::vector<double> at = grid(5000, 0.001);
  std::vector<double> stamps = at;
  for (const std::size_t i : {100, 2000, 3000}) stamps[i] += 0.6e-3;
  const SegmentedAxis axis = segment_axis(sampled(at, stamps), "X");
  ASSERT_EQ(axis.segments.size(), 1U);
  EXPECT_EQ(axis.segments[0].size(), 5000);
  expect_motion(axis.segments[0], 0.0, 1e-12);
}

TEST(Segments, LargeJitterIsResampledOntoTheMedianStepAndSaysSo) {
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

TEST(Segments, LargeJitterKeepsItsGaps) {
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
TEST(Segments, OnlyWhatIsWithinAClocksErrorIsRounded) {
  EXPECT_EQ(segment_axis(sampled(grid(2000, 1.0 / 1024 * (1 + 5e-6))), "X").sample_time_s,
            1.0 / 1024);
  EXPECT_EQ(segment_axis(sampled(grid(2000, 0.002263 * (1 + 5e-6))), "X").sample_time_s, 0.002263);
  EXPECT_NEAR(segment_axis(sampled(grid(2000, 0.0010001)), "X").sample_time_s, 0.0010001, 1e-12);
}

// What cannot be used.

TEST(Segments, RefusesWhatIsNoRecordingOfTheAxis) {
  const auto refuses = [](const Recording& r, const char* axis,
                          std::initializer_list<const char*> parts) {
    expect_error<std::runtime_error>([&] { (void)segment_axis(r, axis); }, parts);
  };
  Recording r = sampled(grid(100, 0.001));
  refuses(r, "Z", {"rec.csv", "no axis 'Z'", "it has X"});
  r.axes[0].command.assign(100, kAbsent);
  refuses(r, "X", {"rec.csv", "X.command has no values"});
  refuses(sampled({1.0}), "X", {"rec.csv", "only one row"});
  refuses(sampled({}), "X", {"rec.csv", "no rows"});
  refuses(sampled(std::vector<double>(100, 0.5)), "X",
          {"time does not advance", "0.5 s in every row"});
  refuses(sampled(grid(100, 0.001), std::vector<double>(100, kAbsent)), "X",
          {"time does not advance"});
  refuses(sampled(grid(9, 0.001)), "X",
          {"no stretch of 10 samples", "the longest has 9 of 9 rows"});
}

TEST(RequireMotion, NamesTheSignalThatStands) {
  const auto refuses = [](const Recording& r, std::initializer_list<const char*> parts) {
    expect_error<std::runtime_error>([&] { require_motion(segment_axis(r, "X")); }, parts);
  };
  Recording r = sampled(grid(100, 0.001));
  EXPECT_NO_THROW(require_motion(segment_axis(r, "X")));
  r.axes[0].actual.assign(100, 0.125);
  refuses(r, {"rec.csv", "X.actual does not move", "0.125 m in all 100 samples"});
  r.axes[0].command.assign(100, 0.5);
  r.axes[0].rotary = true;
  refuses(r, {"X.command does not move", "0.5 rad"});
  r = sampled(grid(100, 0.001));
  r.axes[0].actual.assign(100, kAbsent);
  refuses(r, {"X.actual has no values"});
}

// Any mixture of faults: nothing is lost uncounted, and what comes out is finite, even and in
// order.
TEST(Segments, AccountsBalanceForAnyMixtureOfFaults) {
  std::mt19937_64 random(20);
  int segmented = 0;
  for (int round = 0; round < 2000; ++round) {
    SCOPED_TRACE("round " + std::to_string(round));
    constexpr double kSteps[] = {0.001, 0.0006, 0.002257, 0.01};
    Recording r = sampled(grid(200 + random() % 800, kSteps[random() % 4]));
    const auto any_row = [&] { return static_cast<std::size_t>(random() % r.time.size()); };
    if (random() % 4 == 0) {
      for (double& t : r.time) t = std::round(t * 1e3) / 1e3;
    }
    if (random() % 4 == 0) {
      for (double& t : r.time) t += 1e-4 * static_cast<double>(random() % 10);
    }
    for (auto faults = random() % 8; faults > 0; --faults) {
      const std::size_t row = any_row();
      switch (random() % 5) {
        case 0:
          erase_rows(r, row, std::min<std::size_t>(random() % 30, r.time.size() - row - 1));
          break;
        case 1:
          repeat_row(r, row);
          break;
        case 2:
          r.axes[0].actual[row] = kAbsent;
          break;
        case 3:
          r.time[row] = random() % 2 == 0 ? kAbsent : 1e3 * static_cast<double>(random() % 3);
          break;
        default:
          std::fill_n(r.axes[0].command.begin() + static_cast<std::ptrdiff_t>(row),
                      std::min<std::size_t>(random() % 20, r.time.size() - row), kAbsent);
          break;
      }
    }
    try {
      const SegmentedAxis axis = segment_axis(r, "X");
      ++segmented;
      expect_accounts_to_balance(axis.report);
      EXPECT_EQ(axis.report.rows, r.time.size());
      double end_s = -HUGE_VAL;
      std::size_t samples = 0;
      for (const Segment& s : axis.segments) {
        ASSERT_GE(s.size(), 10);
        ASSERT_EQ(s.actual.size(), s.size());
        ASSERT_EQ(s.torque.size(), s.size());
        ASSERT_TRUE(s.command.isFinite().all() && s.actual.isFinite().all());
        ASSERT_EQ(s.sample_time_s, axis.sample_time_s);
        ASSERT_GT(s.start_s, end_s - axis.sample_time_s);
        end_s = s.end_s();
        samples += static_cast<std::size_t>(s.size());
      }
      if (axis.report.spacing == Spacing::kEven) {
        ASSERT_LE(samples, axis.report.used_rows + axis.report.samples_bridged);
      }
    } catch (const std::runtime_error& error) {
      ASSERT_EQ(std::string(error.what()).find("rec.csv: "), 0U) << error.what();
    }
    if (testing::Test::HasFailure()) break;
  }
  EXPECT_GT(segmented, 1500);
}

// Real recordings.

SegmentedAxis segmented(const std::filesystem::path& file, const char* columns, const char* axis) {
  ReadOptions options;
  options.columns = columns;
  return segment_axis(read_recording(file, options), axis);
}

TEST(RealSegments, EmpsIsOneSegment) {
  SERVOTWIN_REAL_DATA(mat, "emps/DATA_EMPS.mat");
  const SegmentedAxis axis = segmented(mat, "X.command=qg[m],X.actual=qm[m],X.torque=vir[V]", "X");
  ASSERT_EQ(axis.segments.size(), 1U);
  EXPECT_EQ(axis.segments[0].size(), 24'841);
  EXPECT_EQ(axis.sample_time_s, 0.001);
  EXPECT_EQ(axis.report.used_rows, 24'841U);
  EXPECT_EQ(axis.report.lines().size(), 2U) << text_of(axis.report);
  EXPECT_NO_THROW(require_motion(axis));
}

TEST(RealSegments, SinumerikY1IsSplitAtItsGap) {
  SERVOTWIN_REAL_DATA(csv, "sinumerik_edge_5axis/axis_Y1.csv");
  const SegmentedAxis axis = segmented(
      csv, "Y1.command=des_pos[mm],Y1.actual=enc_pos[mm],Y1.torque=torque[Nm],time=t_s[s]", "Y1");
  ASSERT_EQ(axis.segments.size(), 2U);
  EXPECT_EQ(axis.segments[0].size(), 1494);
  EXPECT_EQ(axis.segments[1].size(), 2324);
  EXPECT_EQ(axis.sample_time_s, 0.002);
  ASSERT_EQ(axis.report.splits.size(), 1U);
  EXPECT_NEAR(axis.report.splits[0].length_s, 7.72, 1e-9);
  says(axis.report, "split at 2.986 s by a gap of 7.72 s");
}

TEST(RealSegments, OdriveIsResampled) {
  SERVOTWIN_REAL_DATA(csv, "odrive_cogging/slow_goodgains_2__comp_1.csv");
  const SegmentedAxis axis =
      segmented(csv, "M.command=pos_cmd_counts[rev/8192],M.actual=pos_counts[rev/8192]", "M");
  EXPECT_EQ(axis.report.spacing, Spacing::kUneven);
  EXPECT_NEAR(axis.sample_time_s, 0.00226, 0.00001);
  EXPECT_EQ(axis.report.used_rows, 4360U);
  says(axis.report, "resampled linearly");
}

}  // namespace
}  // namespace servotwin
