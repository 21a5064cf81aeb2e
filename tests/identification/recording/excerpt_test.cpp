#include "identification/recording/excerpt.h"

#include <gtest/gtest.h>

#include <cmath>

namespace servotwin {
namespace {

constexpr double kMillisecond_s = 0.001;

/// At rest, but for a fast swing of a second that begins at these times.
Segment swings(double length_s, const std::vector<double>& at_s) {
  Segment s;
  s.sample_time_s = kMillisecond_s;
  s.start_s = 5.0;
  s.command = Eigen::ArrayXd::Zero(static_cast<Eigen::Index>(length_s / kMillisecond_s));
  for (const double at : at_s) {
    for (Eigen::Index k = 0; k < 1000; ++k)
      s.command(static_cast<Eigen::Index>(at / kMillisecond_s) + k) =
          0.01 * std::sin(2.0 * M_PI * 5e-3 * static_cast<double>(k));
  }
  // Every sample has its own number, so that a cut shows where it was made.
  s.actual = Eigen::ArrayXd::LinSpaced(s.size(), 0.0, static_cast<double>(s.size() - 1));
  return s;
}

TEST(Excerpt, AShortRecordingIsUsedAsItIs) {
  const std::vector<Segment> whole{swings(100.0, {10.0}), swings(100.0, {20.0})};
  const std::vector<Segment> out = excerpt(whole);
  ASSERT_EQ(out.size(), 2U);
  EXPECT_EQ(out[1].size(), whole[1].size());
}

TEST(Excerpt, TakesTheMotionOfEveryPart) {
  // 400 s in 20 parts of 20 s: a swing somewhere in each.
  std::vector<double> at;
  for (int part = 0; part < 20; ++part) at.push_back(20.0 * part + (part * 7) % 18 + 0.5);
  const Segment whole = swings(402.0, at);
  const std::vector<Segment> out = excerpt({whole}, {300.0, 120.0, 6.0});
  double length_s = 0.0;
  int found = 0;
  for (const Segment& s : out) {
    length_s += kMillisecond_s * static_cast<double>(s.size());
    EXPECT_NEAR(s.start_s, 5.0 + kMillisecond_s * s.actual(0), 1e-9) << "its time in the recording";
    EXPECT_EQ(s.actual(s.size() - 1) - s.actual(0), static_cast<double>(s.size() - 1));
    for (const double one : at) {
      if (one >= s.start_s - 5.0 - 0.5 && one <= s.end_s() - 5.0 - 0.5) ++found;
    }
  }
  EXPECT_NEAR(length_s, 120.0, 1e-6);
  EXPECT_GE(found, 18) << "windows of 6 s may cut a swing in two";
}

TEST(Excerpt, WindowsThatFollowEachOtherAreOneSegment) {
  const Segment whole = swings(60.0, {5.5, 6.5, 20.0});
  // Two parts of 30 s; the better windows are the last of the first and the first of the second.
  const Segment joined = swings(60.0, {27.0, 31.0});
  const std::vector<Segment> out = excerpt({joined}, {30.0, 12.0, 6.0});
  ASSERT_EQ(out.size(), 1U);
  EXPECT_NEAR(out[0].start_s, 5.0 + 24.0, 1e-9);
  EXPECT_EQ(out[0].size(), 12'000);
  EXPECT_EQ(excerpt({whole}, {30.0, 12.0, 6.0}).size(), 1U + 1U);
}

}  // namespace
}  // namespace servotwin
