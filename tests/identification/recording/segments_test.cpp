#include "identification/recording/segments.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <random>
#include <sstream>
#include <stdexcept>
#include <string>

#include "drivers/recordings/recording_file.h"
#include "identification/recording/motion_range.h"
#include "identification/recording/same_axis.h"
#include "identification/recording/signals.h"
#include "identification/recording/time_shift.h"
#include "tests/identification/sampled_motion.h"
#include "tests/support/expect_error.h"
#include "tests/support/real_data.h"
#include "twin/two_pi.h"

namespace servotwin {
namespace {

using test::expect_error;

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

TEST(Segments, TheNeighbourIsTheOneThatIsNamedElseTheFirst) {
  Recording r = sampled(grid(2000, 0.001));
  for (const char* name : {"Q", "Y"}) {
    AxisRecord other = r.axes[0];
    other.name = name;
    for (double& x : other.command) x *= name[0] == 'Q' ? 2.0 : 3.0;
    r.axes.push_back(std::move(other));
  }
  const auto beside = [&](const char* name) { return segment_axis(r, "X", {}, name); };
  const double own = beside("").segments[0].command(1500);
  EXPECT_EQ(beside("").neighbour, "Q");
  EXPECT_DOUBLE_EQ(beside("").segments[0].neighbour(1500), 2.0 * own);
  EXPECT_EQ(beside("Y").neighbour, "Y");
  EXPECT_DOUBLE_EQ(beside("Y").segments[0].neighbour(1500), 3.0 * own);
  EXPECT_EQ(beside("Z").neighbour, "");
  EXPECT_EQ(beside("Z").segments[0].neighbour.size(), 0);
}

TEST(Segments, TheEncoderOfTheNeighbourSplitsNothing) {
  const auto beside = [](std::size_t from, std::size_t to) {
    Recording r = sampled(grid(2000, 0.001));
    AxisRecord other = r.axes[0];
    other.name = "Y";
    for (double& x : other.actual) x += 1e-3;
    std::fill(other.actual.begin() + static_cast<std::ptrdiff_t>(from),
              other.actual.begin() + static_cast<std::ptrdiff_t>(to), kAbsent);
    r.axes.push_back(std::move(other));
    SegmentedAxis out = segment_axis(r, "X");
    EXPECT_EQ(out.segments.size(), 1U);
    EXPECT_EQ(out.neighbour, "Y");
    return out.segments[0];
  };
  const Segment whole = beside(0, 0);
  ASSERT_EQ(whole.neighbour_motion.size(), 2000);
  EXPECT_LT((whole.neighbour_motion - whole.actual - 1e-3).abs().maxCoeff(), 1e-12);
  // A run-in that was left out: there it moves as its command does.
  const Segment later = beside(0, 300);
  ASSERT_EQ(later.neighbour_motion.size(), 2000);
  EXPECT_NEAR(later.neighbour_motion(0) - later.neighbour_motion(300),
              later.neighbour(0) - later.neighbour(300), 1e-12);
  EXPECT_EQ(later.neighbour_motion(300), whole.neighbour_motion(300));
  // In between nothing says how it moves.
  EXPECT_EQ(beside(700, 1000).neighbour_motion.size(), 0);
  // Nor does an encoder that stands while its axis is commanded to move.
  Recording stands = sampled(grid(2000, 0.001));
  stands.axes.push_back(stands.axes[0]);
  stands.axes[1].name = "Y";
  stands.axes[1].actual.assign(2000, 0.25);
  EXPECT_EQ(segment_axis(stands, "X").segments[0].neighbour.size(), 2000);
  EXPECT_EQ(segment_axis(stands, "X").segments[0].neighbour_motion.size(), 0);
  // Parts, and recordings that follow each other.
  EXPECT_EQ(part_of(whole, 100, 500).neighbour_motion(7), whole.neighbour_motion(107));
  SegmentedAxis both = segment_axis(sampled(grid(2000, 0.001)), "X"), next = both;
  both.neighbour = next.neighbour = "Y";
  both.segments = {whole};
  next.segments = {whole};
  append(both, next);
  EXPECT_EQ(both.segments[1].neighbour_motion.size(), 2000);
  next.segments = {beside(700, 1000)};
  append(both, next);
  EXPECT_EQ(both.segments[0].neighbour_motion.size(), 0) << "all of it or nothing";
  EXPECT_EQ(both.segments[0].neighbour.size(), 2000);
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
  EXPECT_EQ(axis.report.torque.bridged, 3U);
  EXPECT_EQ(axis.report.torque.missing, 21U);
  says(axis.report, "21 torque values missing");
}

// The motor's encoder beside that of the load; 'sampled' has none.
TEST(Segments, AMissingMotorsEncoderSplitsNothingAndIsCutLikeTheOthers) {
  Recording r = sampled(grid(1000, 0.001));
  r.axes[0].actual_motor = r.axes[0].torque;
  auto& motor = r.axes[0].actual_motor;
  for (const std::size_t i : {0, 100, 101, 102}) motor[i] = kAbsent;
  SegmentedAxis axis = segment_axis(r, "X");
  ASSERT_EQ(axis.segments.size(), 1U);
  EXPECT_NEAR(axis.segments[0].actual_motor[101], torque_at(0.101), 1e-3);
  EXPECT_TRUE(std::isnan(axis.segments[0].actual_motor[0]));
  says(axis.report, "3 motor encoder values bridged");
  says(axis.report, "1 motor encoder value missing");
  EXPECT_EQ(cut(axis.segments, 0.2, 0.5).at(0).actual_motor(7), motor[207]);

  SegmentedAxis with = axis;
  (void)append(with, segment_axis(r, "X"));
  EXPECT_EQ(with.segments.at(1).actual_motor(500), motor[500]);
  (void)append(axis, segment_axis(sampled(grid(500, 0.001)), "X"));
  for (const Segment& s : axis.segments) EXPECT_EQ(s.actual_motor.size(), 0);

  r.axes[0].actual.clear();
  EXPECT_EQ(segment_axis(r, "X").segments[0].actual_motor.size(), 0)
      << "there is nothing beside it";
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
  refuses(sampled(grid(9, 0.001)), "X", {"axis X has 9 rows; at least 10 are needed"});
  std::vector<double> torn = grid(18, 0.001);
  for (std::size_t k = 9; k < torn.size(); ++k) torn[k] += 5.0;
  refuses(sampled(torn), "X", {"no segment of 10 samples", "the longest has 9 of 18 rows"});
}

TEST(RequireMotion, RefusesWhatNoMachineDoes) {
  const auto moving = [](double amplitude, double hz, bool rotary) {
    Recording r = sampled(grid(20'000, 0.001));
    for (std::size_t k = 0; k < r.time.size(); ++k)
      r.axes[0].command[k] = amplitude * std::sin(2.0 * M_PI * hz * r.time[k]);
    r.axes[0].actual = r.axes[0].command;
    r.axes[0].rotary = rotary;
    return segment_axis(r, "X");
  };
  const auto refuses = [](const SegmentedAxis& axis, std::initializer_list<const char*> parts) {
    expect_error<std::runtime_error>([&] { require_motion(axis); }, parts);
  };
  // 40 mm at 1 Hz, read as metres; a stroke of 300 mm at 0.02 Hz, read as metres.
  refuses(moving(40.0, 1.0, false),
          {"X.command moves at up to 251 m/s", "is its unit mm and not m?"});
  refuses(moving(150.0, 0.02, false), {"X.command", "is its unit mm and not m?"});
  // A turn of 360 degrees at 10 Hz, read as radians.
  refuses(moving(360.0, 10.0, true), {"X.command moves at up to", "rad/s", "deg and not rad?"});
  EXPECT_NO_THROW(require_motion(moving(0.5, 1.0, false)));
  EXPECT_NO_THROW(require_motion(moving(2.0 * M_PI, 10.0, true)));
  Recording steps = sampled(grid(2000, 0.001));
  for (std::size_t k = 0; k < steps.time.size(); ++k)
    steps.axes[0].command[k] = k / 500 % 2 == 0 ? 0.0 : 0.01;
  steps.axes[0].actual = steps.axes[0].command;
  refuses(segment_axis(steps, "X"), {"X.command jumps by up to 0.01 m", "is a target"});
  // Slow motion that is recorded in steps of an encoder is no such jump.
  for (std::size_t k = 0; k < steps.time.size(); ++k) {
    const std::size_t counts = k / 50;
    steps.axes[0].command[k] = 1e-5 * static_cast<double>(counts);
  }
  steps.axes[0].actual = steps.axes[0].command;
  EXPECT_NO_THROW(require_motion(segment_axis(steps, "X")));
}

TEST(RequireMotion, RefusesARateThatIsNoServosAndSaysWhichIsNeeded) {
  const auto at = [](double step_s) {
    Recording r = sampled(grid(1000, step_s));
    for (std::size_t k = 0; k < r.time.size(); ++k)
      r.axes[0].command[k] = 0.1 * std::sin(0.2 * static_cast<double>(k));
    r.axes[0].actual = r.axes[0].command;
    return segment_axis(r, "X");
  };
  const auto refuses = [](const SegmentedAxis& axis, std::initializer_list<const char*> parts) {
    expect_error<std::runtime_error>([&] { require_motion(axis); }, parts);
  };
  refuses(at(0.1), {"rec.csv", "X: one sample every 0.1 s", "at least every 0.05 s", "ms or us"});
  refuses(at(1e-6), {"rec.csv", "1e+06 samples per second", "unit of the time"});
  EXPECT_NO_THROW(require_motion(at(0.05)));
}

TEST(LeadIn, IsTheMotionBeforeAPart) {
  // 0.1 mm per sample, after a rest of 100 samples; then a second segment that rests.
  Segment moves, rests;
  moves.sample_time_s = rests.sample_time_s = 1e-3;
  moves.start_s = 2.0;
  moves.actual = moves.command = Eigen::ArrayXd::LinSpaced(400, -0.01, 0.0299).max(0.0);
  rests.start_s = 5.0;
  rests.actual = rests.command = Eigen::ArrayXd::Constant(400, 0.03);
  const std::vector<Segment> whole{moves, rests};
  const auto parts = cut(whole, 2.25, 5.1);
  ASSERT_EQ(parts.size(), 2U);

  const auto all = with_lead_in(parts, whole);
  EXPECT_EQ(all[0].start_s, 2.0);
  EXPECT_EQ(all[0].lead, 250);
  EXPECT_EQ(all[0].size(), 400);
  EXPECT_EQ(all[1].lead, 0) << "a part that begins with its segment";
  EXPECT_EQ(all[1].size(), 101);

  const auto some = with_lead_in(parts, whole, 1e-3);
  EXPECT_EQ(some[0].lead, 10) << "0.1 mm per sample";
  EXPECT_NEAR(some[0].start_s, 2.24, 1e-9);
  EXPECT_EQ(some[0].command(10), parts[0].command(0));
  EXPECT_EQ(some[0].size(), 10 + parts[0].size());

  const auto standing = with_lead_in(cut(whole, 2.05, 2.09), whole, 1e-3);
  EXPECT_EQ(standing[0].lead, 50) << "all there is";
  std::vector<Segment> led = cut(whole, 2.25, 3.0);
  led[0].lead = 20;
  EXPECT_EQ(with_lead_in(led, whole, 1e-3)[0].lead, 30) << "in front of its own";
}

TEST(AppendedSegments, FollowTheOthersWithTheirOwnStart) {
  SegmentedAxis first = segment_axis(sampled(grid(2000, 0.001)), "X");
  Recording later = sampled(grid(500, 0.001));
  for (double& t : later.time) t += 7200.0;
  later.source = "other.csv";
  EXPECT_DOUBLE_EQ(append(first, segment_axis(later, "X")), 1.999 + 1.0);
  ASSERT_EQ(first.segments.size(), 2U);
  EXPECT_EQ(first.segments[1].size(), 500);
  EXPECT_NEAR(first.segments[1].start_s, 2.999, 1e-9);
  expect_motion(first.segments[0], 0.0, 1e-12);
  EXPECT_EQ(first.segments[1].actual(100), later.axes[0].actual[100]);
  EXPECT_EQ(first.segments[1].torque(100), later.axes[0].torque[100]);
  EXPECT_EQ(first.source, "rec.csv, other.csv");
  EXPECT_EQ(first.torque_unit, "Nm");
}

TEST(AppendedSegments, TorqueIsUsedWhereAllHaveIt) {
  Recording without = sampled(grid(500, 0.001));
  without.axes[0].torque.clear();
  SegmentedAxis first = segment_axis(sampled(grid(2000, 0.001)), "X");
  (void)append(first, segment_axis(without, "X"));
  EXPECT_EQ(first.torque_unit, "");
  for (const Segment& s : first.segments) EXPECT_EQ(s.torque.size(), 0);
}

TEST(AppendedSegments, WhatCannotBeFittedTogetherIsRefused) {
  const auto refuses = [](const std::function<void(Recording&)>& change, double step_s,
                          std::initializer_list<const char*> parts) {
    SegmentedAxis first = segment_axis(sampled(grid(2000, 0.001)), "X");
    Recording other = sampled(grid(500, step_s));
    other.source = "other.csv";
    change(other);
    expect_error<std::runtime_error>([&] { (void)append(first, segment_axis(other, "X")); }, parts);
    EXPECT_EQ(first.segments.size(), 1U);
  };
  refuses([](Recording&) {}, 0.002,
          {"other.csv cannot be used together with rec.csv", "1 ms there, 2 ms here"});
  refuses([](Recording& r) { r.axes[0].rotary = true; }, 0.001, {"linear there, rotary here"});
  refuses([](Recording& r) { r.axes[0].torque_unit = "A"; }, 0.001, {"Nm there, A here"});
  refuses([](Recording& r) { r.axes[0].actual.assign(500, kAbsent); }, 0.001,
          {"only one of them has an encoder"});
}

/// 20 s of moves between rests, or of `hz` where that is not zero; the encoder as `follow` gives it
/// from the command at every time.
template <class Follow>
SegmentedAxis followed(double hz, Follow follow) {
  const auto command = [hz](double t) {
    if (hz > 0.0) return 0.1 * std::sin(2.0 * M_PI * hz * t);
    const double part = t - 2.0 * std::floor(t / 2.0), share = std::clamp(part / 0.5, 0.0, 1.0);
    const double from = std::sin(3.0 * std::floor(t / 2.0)),
                 to = std::sin(3.0 * std::floor(t / 2.0) + 3.0);
    return 0.1 * (from + (to - from) * share * share * (3.0 - 2.0 * share));
  };
  Recording r = sampled(grid(20'000, 0.001));
  for (std::size_t k = 0; k < r.time.size(); ++k) {
    r.axes[0].command[k] = command(r.time[k]);
    r.axes[0].actual[k] = follow(command, r.time[k]);
  }
  return segment_axis(r, "X");
}

/// A loop of first order of this time constant.
auto lagging(double constant_s) {
  return [constant_s, x = 0.0](const auto& command, double t) mutable {
    return x += (command(t) - x) * 0.001 / constant_s;
  };
}

TEST(RequireMotion, RefusesAnEncoderThatWasRecordedAtAnotherTime) {
  const auto later = [](double s) {
    return [s](const auto& command, double t) { return command(std::max(0.0, t - s)); };
  };
  const auto refuses = [](const SegmentedAxis& axis, std::initializer_list<const char*> parts) {
    expect_error<std::runtime_error>([&] { require_motion(axis); }, parts);
  };
  refuses(followed(0.0, later(0.5)), {"X.actual shows the commanded motion 0.5 s later", "clock"});
  refuses(followed(0.0, later(-0.5)), {"X.actual shows the commanded motion 0.5 s before"});
  // What a servo does: a delay of a few cycles, a slow loop, and one whose motion repeats.
  EXPECT_NO_THROW(require_motion(followed(0.0, later(0.02))));
  for (const double constant_s : {0.02, 0.1, 0.4})
    EXPECT_NO_THROW(require_motion(followed(0.0, lagging(constant_s)))) << constant_s;
  for (const double hz : {0.3, 1.0, 3.0}) {
    EXPECT_NO_THROW(require_motion(followed(hz, lagging(0.03)))) << hz;
    EXPECT_NO_THROW(require_motion(followed(hz, later(0.03)))) << hz;
    EXPECT_NO_THROW(require_motion(followed(hz, later(-0.003)))) << hz;
  }
}

TEST(RemarkOnTime, NamesADelayThatIsNoLag) {
  const auto remark = [](const SegmentedAxis& axis) { return remark_on_time(axis.segments); };
  const auto later = [](double s) {
    return [s](const auto& command, double t) { return command(std::max(0.0, t - s)); };
  };
  for (const double late_s : {0.06, 0.12, 0.2}) {
    const auto axis = followed(0.0, later(late_s));
    EXPECT_NO_THROW(require_motion(axis)) << late_s;
    std::ostringstream said;
    said << "shows the commanded motion " << late_s << " s later";
    EXPECT_NE(remark(axis).find(said.str()), std::string::npos) << remark(axis);
  }
  EXPECT_EQ(remark(followed(0.0, later(0.02))), "");
  for (const double constant_s : {0.02, 0.1, 0.2}) {
    EXPECT_EQ(remark(followed(0.0, lagging(constant_s))), "") << constant_s;
    for (const double hz : {0.3, 1.0, 3.0})
      EXPECT_EQ(remark(followed(hz, lagging(constant_s))), "") << hz << " Hz, " << constant_s;
    // Two lags, one behind the other: the lateness of a delay with less smoothing.
    EXPECT_EQ(remark(followed(0.0,
                              [one = lagging(0.5 * constant_s), two = 0.0, constant_s](
                                  const auto& command, double t) mutable {
                                return two += (one(command, t) - two) * 0.001 / (0.5 * constant_s);
                              })),
              "")
        << constant_s;
  }
}

TEST(SameAxis, IsToldByLagAndFriction) {
  // error = lag v + inertia a + friction sign v, exactly.
  const auto axis = [](double lag_s, double friction, double hz) {
    Recording r = sampled(grid(8000, 0.001));
    for (std::size_t k = 0; k < r.time.size(); ++k) {
      const double w = 2.0 * M_PI * hz, x = w * r.time[k], v = 0.1 * w * std::cos(x);
      r.axes[0].command[k] = 0.1 * std::sin(x);
      r.axes[0].actual[k] = r.axes[0].command[k] - lag_s * v + 1e-5 * w * w * 0.1 * std::sin(x) -
                            std::copysign(friction, v);
    }
    return segment_axis(r, "X").segments;
  };
  const auto noisy = [](std::vector<Segment> segments, unsigned seed) {
    std::mt19937_64 random(seed);
    std::normal_distribution<double> noise(0.0, 2e-6);
    for (Segment& s : segments) {
      for (double& x : s.actual) x += noise(random);
    }
    return segments;
  };
  const auto one = noisy(axis(0.01, 1e-5, 0.5), 1);
  EXPECT_NEAR(common_over_own(one, noisy(axis(0.01, 1e-5, 0.7), 2)), 1.0, 0.05);
  EXPECT_GT(common_over_own(one, noisy(axis(0.013, 1e-5, 0.7), 3)), kMaxCommonOverOwn);
  EXPECT_GT(common_over_own(one, noisy(axis(0.01, 3e-5, 0.7), 4)), kMaxCommonOverOwn);
  EXPECT_EQ(common_over_own(one, {}), 1.0);
}

TEST(RequireMotion, RefusesAnEncoderThatCannotBelongToTheCommand) {
  const auto encoder = [](double factor, bool rotary) {
    Recording r = sampled(grid(2000, 0.001));
    for (std::size_t k = 0; k < r.time.size(); ++k) {
      r.axes[0].command[k] = 0.1 * std::sin(2.0 * M_PI * r.time[k]);
      r.axes[0].actual[k] = factor * r.axes[0].command[k];
    }
    r.axes[0].rotary = rotary;
    return r;
  };
  const auto refuses = [](const Recording& r, std::initializer_list<const char*> parts) {
    expect_error<std::runtime_error>([&] { require_motion(segment_axis(r, "X")); }, parts);
  };
  refuses(encoder(1000.0, false), {"rec.csv", "X.actual travels 200 m", "0.2 m", "mm", "um"});
  refuses(encoder(1.0 / 25.4, false), {"X.actual travels 0.0078", "inches"});
  refuses(encoder(-10.0, false), {"X.actual", "cm"});
  refuses(encoder(180.0 / M_PI, true), {"X.actual", "degrees", "radians"});
  refuses(encoder(0.01, false), {"X.actual", "the position error"});
  refuses(encoder(1.0 / 27.0, false), {"X.actual", "the position error"});  // no inches
  // An axis with much lag or overshoot, and single wrong values.
  EXPECT_NO_THROW(require_motion(segment_axis(encoder(0.3, false), "X")));
  EXPECT_NO_THROW(require_motion(segment_axis(encoder(3.0, false), "X")));
  Recording spikes = encoder(1.0, false);
  spikes.axes[0].actual[777] = 50.0;
  EXPECT_NO_THROW(require_motion(segment_axis(spikes, "X")));
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

// The bounds of friction and play are lengths of machines, and angles where a motor turns faster.
TEST(LengthScale, IsThatOfTheWholeRecordingOnARotaryAxisOnly) {
  const auto sine = [](double amplitude, bool rotary) {
    Recording r = sampled(grid(2000, 0.001));
    r.axes[0].rotary = rotary;
    for (std::size_t i = 0; i < r.time.size(); ++i) {
      r.axes[0].command[i] = amplitude * std::sin(kTwoPi * r.time[i]);
      r.axes[0].actual[i] = 0.99 * r.axes[0].command[i];
    }
    return segment_axis(r, "X");
  };
  // A sine of 10 rad and 1 Hz turns at 62.8 rad/s, 31.4 times 2 rad/s.
  SegmentedAxis motor = sine(10.0, true);
  EXPECT_NEAR(length_scale(motor.segments), 31.4, 0.05);
  EXPECT_EQ(length_scale(sine(10.0, false).segments), 1.0) << "a linear axis of 62.8 m/s";
  EXPECT_EQ(length_scale(sine(0.1, true).segments), 1.0) << "0.63 rad/s";
  // Around a reversal, where it turns at 10 rad/s at most.
  const Segment part = part_of(motor.segments[0], 225, 50);
  EXPECT_EQ(part.length_scale, motor.segments[0].length_scale);
  const Signals thinned = decimated(signals_of(part), 2);
  EXPECT_EQ(thinned.length_scale, motor.segments[0].length_scale);
  append(motor, sine(20.0, true));
  EXPECT_NEAR(motor.segments.front().length_scale, 62.8, 0.1);
  EXPECT_NEAR(motor.segments.back().length_scale, 62.8, 0.1);
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
