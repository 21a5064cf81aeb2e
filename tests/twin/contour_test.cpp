#include "twin/contour.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <vector>

namespace servotwin {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kRadian = kPi / 180.0;

PathPoint operator+(PathPoint a, const PathPoint& b) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] += b[i];
  return a;
}
PathPoint operator*(double s, PathPoint a) {
  for (double& x : a) x *= s;
  return a;
}
double norm(const PathPoint& a) {
  double out = 0.0;
  for (const double x : a) out += x * x;
  return std::sqrt(out);
}

ContourError along(int axes, const std::vector<PathPoint>& path) {
  ContourError contour(axes);
  for (const PathPoint& command : path) contour.move(command);
  return contour;
}

PathPoint on_circle(double radius, double angle) {
  return {radius * std::cos(angle), radius * std::sin(angle)};
}

// Line under an angle: eps = -e_x sin + e_y cos, whatever the lag along it.
TEST(ContourError, OfALineIsTheErrorAcrossIt) {
  const PathPoint e{0.012e-3, -0.004e-3};
  for (const double angle : {0.0, 30.0 * kRadian, 135.0 * kRadian, 200.0 * kRadian, 1.5 * kPi}) {
    const PathPoint direction{std::cos(angle), std::sin(angle)};
    ContourError contour(2);
    for (int k = 0; k <= 100; ++k) contour.move((1e-5 * k) * direction);
    for (const double lag : {0.0, 3e-5, 4.321e-4}) {
      const PathPoint p = (1e-3 - lag) * direction + (-1.0) * e;
      const double expected = -e[0] * std::sin(angle) + e[1] * std::cos(angle);
      EXPECT_NEAR(contour.of(p, {}), expected, 1e-17) << angle << ", " << lag;
    }
  }
}

TEST(ContourError, OfALineInFiveAxesIsTheNormOfWhatIsAcrossIt) {
  const PathPoint direction{2.0 / 7.0, -4.0 / 7.0, 1.0 / 7.0, 2.0 / 7.0, std::sqrt(24.0) / 7.0};
  ASSERT_NEAR(norm(direction), 1.0, 1e-15);
  ContourError contour(5);
  for (int k = 0; k <= 100; ++k) contour.move((1e-5 * k) * direction);
  const PathPoint e{3e-6, 1e-6, -2e-6, 5e-6, 7e-6};
  double lag = 0.0;
  for (std::size_t i = 0; i < 5; ++i) lag += e[i] * direction[i];
  const double across = norm(e + (-lag) * direction);
  EXPECT_NEAR(contour.of((1e-3) * direction + (-1.0) * e, {}), across, 1e-17);
}

// eps = |P - centre| - R on a circle run counter-clockwise, the opposite clockwise; the reference
// has R = 5 mm, e = (30, -20) um at 40 degrees: -10.005592 um.
TEST(ContourError, OfACircleIsTheErrorOfItsRadius) {
  const double radius = 5e-3, at = 40.0 * kRadian, step = 1e-6 / radius;
  for (const double way : {1.0, -1.0}) {
    std::vector<PathPoint> path, ahead;
    for (int k = 400; k >= 0; --k) path.push_back(on_circle(radius, at - way * k * step));
    for (int k = 1; k <= 100; ++k) ahead.push_back(on_circle(radius, at + way * k * step));
    const ContourError contour = along(2, path);
    const PathPoint p = on_circle(radius, at) + PathPoint{-0.03e-3, 0.02e-3};
    EXPECT_NEAR(norm(p) - radius, -10.005592287540388e-6, 1e-15);
    const double chord = (radius * step) * (radius * step) / (8.0 * radius);
    EXPECT_NEAR(contour.of(p, ahead), way * (norm(p) - radius), chord + 1e-15);
    // Outside of it, with a lag.
    const PathPoint q = (1.0 + 2e-3) * on_circle(radius, at - way * 150 * step);
    EXPECT_NEAR(contour.of(q, ahead), way * 2e-3 * radius, chord + 1e-15);
  }
}

// The helix of the reference: R = 20 mm, 3 mm per radian, at 0.7.
TEST(ContourError, OfAHelixIsThatOfTheReference) {
  const auto helix = [](double u) {
    return PathPoint{20e-3 * std::cos(u), 20e-3 * std::sin(u), 3e-3 * u};
  };
  ContourError contour(3);
  for (int k = 300; k >= 0; --k) contour.move(helix(0.7 - 1e-4 * k));
  const PathPoint p = helix(0.7) + PathPoint{-0.05e-3, -0.08e-3, 0.06e-3};
  const double chord = std::pow(2.03e-6, 2) / (8.0 * 20e-3);
  EXPECT_NEAR(contour.of(p, {}), 0.11003635895902535e-3, chord + 1e-13);
}

TEST(ContourError, IsTheDistanceFromThePathAndNotFromItsSamples) {
  const ContourError contour = along(2, {{0.0, 0.0}, {1e-3, 0.0}, {2e-3, 0.0}});
  EXPECT_DOUBLE_EQ(contour.of({1.5e-3, 2e-6}, {}), -2e-6) << "left";
  EXPECT_DOUBLE_EQ(contour.of({0.5e-3, -2e-6}, {}), 2e-6) << "right";
}

TEST(ContourError, OnlyThePlaneHasASign) {
  const ContourError contour = along(3, {{0.0, 0.0, 0.0}, {1e-3, 0.0, 0.0}});
  EXPECT_DOUBLE_EQ(contour.of({0.5e-3, 2e-6}, {}), 2e-6);
  EXPECT_DOUBLE_EQ(contour.of({0.5e-3, -3e-6, 4e-6}, {}), 5e-6);
}

// A corner to the left, run through by 1 mm; the point lags behind it.
TEST(ContourError, AtACornerIsThatOfTheNearerLegOrOfTheCornerItself) {
  std::vector<PathPoint> path;
  for (int k = 0; k <= 10; ++k) path.push_back({1e-4 * k, 0.0});
  for (int k = 1; k <= 10; ++k) path.push_back({1e-3, 1e-4 * k});
  const ContourError contour = along(2, path);
  EXPECT_NEAR(contour.of({0.9e-3, 0.05e-3}, {}), -0.05e-3, 1e-18) << "nearer to the first leg";
  EXPECT_NEAR(contour.of({0.95e-3, 0.1e-3}, {}), -0.05e-3, 1e-18) << "nearer to the second";
  EXPECT_NEAR(contour.of({1.03e-3, -0.04e-3}, {}), 0.05e-3, 1e-18) << "outside of the corner";
}

// The path came past the point, went away from it, and comes back: the first look is not the last.
TEST(ContourError, WhatIsNearerFurtherBackIsFound) {
  constexpr double kUnit = 1e-5;
  const std::vector<PathPoint> ends{{15.0, 0.5}, {2.0, 0.5}, {0.0, 13.0}, {0.0, 10.0}};
  ContourError contour(2);
  for (std::size_t leg = 1; leg < ends.size(); ++leg) {
    for (int k = 0; k <= 100; ++k) {
      const double t = k / 100.0;
      contour.move(kUnit * ((1.0 - t) * ends[leg - 1] + t * ends[leg]));
    }
  }
  contour.move(kUnit * ends.back());  // it stands, or it would go on to the point
  EXPECT_NEAR(std::abs(contour.of({0.0, 0.0}, {})), kUnit * std::sqrt(4.25), 1e-17);
}

TEST(ContourError, APathThatCrossesItselfIsMeasuredWhereTheAxesAre) {
  // A loop of 10 mm, then across its start at a right angle.
  std::vector<PathPoint> path;
  for (int k = -20; k <= 20; ++k) path.push_back({1e-4 * k, 0.0});
  for (int k = 1; k <= 20; ++k) path.push_back({2e-3, 1e-4 * k});
  for (int k = 19; k >= 0; --k) path.push_back({1e-4 * k, 2e-3});
  for (int k = 19; k >= -5; --k) path.push_back({0.0, 1e-4 * k});
  // 1 um from the line that was run long ago, 30 um from the one that is run now.
  EXPECT_NEAR(along(2, path).of({30e-6, 1e-6}, {}), -30e-6, 1e-18);
}

TEST(ContourError, PastTheLastCommandThePathGoesOnWhileItMovesAndEndsWhereItStands) {
  ContourError contour = along(2, {{0.0, 0.0}, {1e-3, 0.0}});
  EXPECT_NEAR(contour.of({1e-3 + 4e-6, -3e-6}, {}), 3e-6, 1e-18);
  contour.move({1e-3, 0.0});
  EXPECT_NEAR(contour.of({1e-3 + 4e-6, -3e-6}, {}), 5e-6, 1e-18);
  EXPECT_NEAR(contour.of({1e-3 + 4e-6, 0.0}, {}), 4e-6, 1e-18) << "too far is too far";
}

TEST(ContourError, KnowsThePathAhead) {
  ContourError contour = along(2, {{0.0, 0.0}, {1e-3, 0.0}});
  const std::vector<PathPoint> stop{{1e-3, 0.0}}, corner{{1.001e-3, 0.0}, {1.001e-3, 1e-3}},
      broken{{1.001e-3, 0.0}, {kAbsent, 0.0}};
  EXPECT_NEAR(contour.of({1e-3 + 4e-6, -3e-6}, stop), 5e-6, 1e-18);
  EXPECT_NEAR(contour.of({1.001e-3 + 2e-6, 20e-6}, corner), 2e-6, 1e-18);
  EXPECT_NEAR(contour.of({1.001e-3 + 20e-6, 2e-6}, broken), -2e-6, 1e-18);
}

TEST(ContourError, StandingAndCreepingCommandsUseNothingUp) {
  ContourError contour(2);
  for (int k = 0; k <= 100; ++k) contour.move({1e-5 * k, 0.0});
  for (int k = 0; k < 10'000; ++k) contour.move({1e-3, 0.0});
  EXPECT_DOUBLE_EQ(contour.of({0.5e-3, 2e-6}, {}), -2e-6);
  for (int k = 1; k <= 10'000; ++k) contour.move({1e-3 + 1e-10 * k, 0.0});  // 1 um
  EXPECT_NEAR(contour.of({0.5e-3, 2e-6}, {}), -2e-6, 1e-18);
}

TEST(ContourError, WhatIsNotKnownIsNotANumber) {
  ContourError contour(2);
  EXPECT_TRUE(std::isnan(contour.of({0.0, 0.0}, {}))) << "no command yet";
  contour.move({0.0, 0.0});
  EXPECT_EQ(contour.of({0.0, 0.0}, {}), 0.0);
  EXPECT_TRUE(std::isnan(contour.of({kAbsent, 0.0}, {})));
  contour.move({1e-3, 0.0});
  contour.move({kAbsent, 0.0});
  EXPECT_TRUE(std::isnan(contour.of({0.0, 0.0}, {}))) << "a gap";
  contour.move({1.0, 0.0});
  EXPECT_EQ(contour.of({1.0, 3e-6}, {}), 3e-6) << "what was before the gap is no part of it";
  for (int k = 1; k < 2 * ContourError::kCorners; ++k) contour.move({1.0 + 1e-5 * k, 0.0});
  const double back = 1e-5 * ContourError::kCorners,
               end = 1.0 + 1e-5 * (2 * ContourError::kCorners - 1);
  EXPECT_NEAR(contour.of({end - back + 5e-5, 2e-6}, {}), -2e-6, 1e-15);
  EXPECT_TRUE(std::isnan(contour.of({end - back - 5e-5, 2e-6}, {}))) << "forgotten already";
  contour.move({1e308, -1e308});
  EXPECT_FALSE(std::isinf(contour.of({0.0, 0.0}, {})));
}

// Against every point of the path, one by one, where the path is smooth and does not come near
// itself.
TEST(ContourError, IsWhatTryingEveryPointFinds) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> any(-1.0, 1.0);
  const auto curve = [](double t) {
    return PathPoint{0.02 * std::sin(7.0 * t), 0.03 * t, 0.01 * std::cos(5.0 * t)};
  };
  for (int trial = 0; trial < 50; ++trial) {
    const double now = 1.0 + any(random);
    ContourError contour(3);
    std::vector<PathPoint> path, ahead;
    for (int k = 200; k >= 0; --k) path.push_back(curve(now - 1e-3 * k));
    for (int k = 1; k <= 20; ++k) ahead.push_back(curve(now + 1e-3 * k));
    for (const PathPoint& command : path) contour.move(command);
    const PathPoint p = curve(now - 0.03 * (1.0 + any(random))) +
                        PathPoint{2e-4 * any(random), 2e-4 * any(random), 2e-4 * any(random)};
    path.insert(path.end(), ahead.begin(), ahead.end());
    double nearest = 1.0;
    for (std::size_t k = 1; k < path.size(); ++k) {
      for (int part = 0; part <= 200; ++part) {
        const double t = part / 200.0;
        const PathPoint c = (1.0 - t) * path[k - 1] + t * path[k];
        nearest = std::min(nearest, norm(p + (-1.0) * c));
      }
    }
    const double found = contour.of(p, ahead);
    EXPECT_LE(found, nearest + 1e-15) << trial;
    EXPECT_GE(found, nearest - 2e-7) << trial << ": half a part of a chord to the side";
  }
}

}  // namespace
}  // namespace servotwin
