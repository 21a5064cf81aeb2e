// The tracking and contour error expected from a repair, against closed forms.
#include "diagnosis/search/gain.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "twin/twin.h"

namespace servotwin {
namespace {

constexpr double kGainStep_s = 1e-3;

/// A loop of order 2 with a velocity error of c1/a2 and no forces.
Model lagging() {
  Model model;
  model.sample_time_s = kGainStep_s;
  model.loop.order = 2;
  model.loop.denominator = {400.0, 40'000.0, 0.0};
  model.loop.numerator = {0.0, 400.0, 0.0};
  return model;
}

/// Motion at constant speed along a line at this angle to the axis.
Segment line(double angle, bool in_plane) {
  Segment s;
  s.sample_time_s = kGainStep_s;
  s.command = Eigen::ArrayXd::LinSpaced(4001, 0.0, 0.4) * std::cos(angle);
  s.neighbour = Eigen::ArrayXd::LinSpaced(4001, 0.0, 0.4) * std::sin(angle);
  s.in_plane = in_plane;
  return s;
}

TEST(Repair, BringsTheLagAndItsPartAcrossThePath) {
  Model repaired = lagging();
  repaired.loop.numerator[1] = 100.0;
  for (const double angle : {0.3, 0.8, 1.4}) {
    Gain gain;
    judge_repair(lagging(), repaired, {line(angle, true)}, gain);
    const double lag = 0.1 * std::cos(angle) * 400.0 / 40'000.0;
    EXPECT_NEAR(gain.tracking_now, lag, 1e-3 * lag);
    EXPECT_NEAR(gain.tracking_repaired, 0.25 * lag, 1e-3 * lag);
    EXPECT_NEAR(gain.contour_now, lag * std::sin(angle), 1e-3 * lag);
    EXPECT_NEAR(gain.contour_repaired, 0.25 * lag * std::sin(angle), 1e-3 * lag);
  }
}

TEST(Repair, SaysNothingAboutAPathWithARotaryNeighbour) {
  Gain gain;
  judge_repair(lagging(), lagging(), {line(0.8, false)}, gain);
  EXPECT_TRUE(std::isfinite(gain.tracking_now));
  EXPECT_TRUE(std::isnan(gain.contour_now));
}

// 0.7 s of motion in 12 s: a few of a hundred resamples of all intervals alike would contain no
// motion at all, and so no gain.
TEST(Gain, OfOneMoveInALongRestIsNotZero) {
  Segment s;
  s.sample_time_s = kGainStep_s;
  s.command.setZero(12'001);
  for (Eigen::Index k = 6000; k < 12'001; ++k)
    s.command(k) = 1e-4 * static_cast<double>(std::min<Eigen::Index>(k - 6000, 700));
  s.actual = s.command - simulate(lagging(), s);
  Model without = lagging();
  without.loop.numerator[1] = 0.0;
  const Gain gain = gain_of(without, lagging(), {s});
  EXPECT_GT(gain.before, 1e-5);
  EXPECT_LT(gain.after, 1e-9);
  EXPECT_GT(gain.low, 0.25 * gain.before);
  EXPECT_LT(gain.high, 4.0 * gain.before);
}

}  // namespace
}  // namespace servotwin
