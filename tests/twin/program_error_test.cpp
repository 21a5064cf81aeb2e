#include "twin/program_error.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "twin/contour_shares.h"
#include "twin/twin.h"
#include "twin/two_pi.h"

namespace servotwin {
namespace {

using Eigen::ArrayXd;

/// Two axes on a circle of 5 mm, counter-clockwise at `omega`, `rate` samples per second.
std::vector<ArrayXd> circle(double omega, double h, Eigen::Index n) {
  const ArrayXd angle = ArrayXd::LinSpaced(n, 0.0, omega * h * static_cast<double>(n - 1));
  return {5e-3 * angle.cos(), 5e-3 * angle.sin()};
}

TEST(ProgramError, OfACircleIsTheErrorOfItsRadiusWhateverTheLag) {
  const double h = 1e-3, omega = 20.0;
  const auto command = circle(omega, h, 900);
  std::vector<ArrayXd> actual = command;
  for (const double lag : {0.0, 0.2}) {
    for (Eigen::Index k = 0; k < 900; ++k) {
      const double angle = omega * h * static_cast<double>(k) - lag;
      actual[0](k) = 4.98e-3 * std::cos(angle), actual[1](k) = 4.98e-3 * std::sin(angle);
    }
    const ProgramError error = program_error(command, actual);
    for (Eigen::Index k = 20; k < 880; ++k) {
      EXPECT_NEAR(error.distance(k), -20e-6, 5e-3 * std::pow(omega * h, 2.0) / 8.0) << k;
      EXPECT_NEAR(error.place(k), static_cast<double>(k) - lag / (omega * h), 0.01) << k;
    }
  }
}

// Two equal linear loops on a circle: eps = R (|T| - 1); the reference has -160.891 um.
TEST(ProgramError, OfTwoEqualLoopsIsWhatTheReferenceSays) {
  Model model;
  const double h = model.sample_time_s = 0.6e-3;
  model.loop.denominator = denominator_of({kTwoPi * 9.87, kTwoPi * 31.31, 0.44}, 3);
  model.loop.numerator = {1.0, model.loop.denominator[0], model.loop.denominator[2] / 75.0};
  const auto command = circle(20.0, h, 3000);
  std::vector<ArrayXd> actual;
  std::vector<Segment> paths;
  for (const ArrayXd& axis : command) {
    Segment segment;
    segment.sample_time_s = h;
    segment.command = axis;
    paths.push_back(segment);
    actual.push_back(axis - simulate(model, segment));
  }
  const ProgramError error = program_error(command, actual);
  EXPECT_NEAR(error.distance.tail(1500).mean(), -160.89124581632808e-6, 0.1e-6);

  // All of it is the loops', and both have half of it on whole circles.
  const std::vector<ContourShare> shares = contour_shares({model, model}, paths, error);
  ASSERT_EQ(shares.size(), 3U);
  EXPECT_EQ(shares[0].what, "loop");
  EXPECT_EQ(shares[1].what, "loop");
  EXPECT_NEAR(shares[0].share, 0.5, 0.03);
  EXPECT_NEAR(shares[2].share, 0.0, 1e-3) << "the rest: chords for arcs";
}

TEST(ProgramError, AndTheLiveOneAreTheSame) {
  std::mt19937_64 random(3);
  std::normal_distribution<double> normal;
  for (const int axes : {2, 3, 5}) {
    const Eigen::Index n = 400;
    std::vector<ArrayXd> command, actual;
    for (int i = 0; i < axes; ++i) {
      const ArrayXd t = ArrayXd::LinSpaced(n, 0.0, 0.4);
      command.push_back(0.01 * (t * (8.0 + 3.0 * i) + normal(random)).sin());
      ArrayXd late = command.back();
      late.tail(n - 7) = command.back().head(n - 7).eval();
      for (double& x : late) x += 5e-6 * normal(random);
      actual.push_back(late);
    }
    const ProgramError whole = program_error(command, actual);
    ContourError live(axes);
    const auto at = [](const std::vector<ArrayXd>& of, Eigen::Index k) {
      PathPoint out{};
      for (std::size_t i = 0; i < of.size(); ++i) out[i] = of[i](k);
      return out;
    };
    for (Eigen::Index k = 0; k < n; ++k) {
      live.move(at(command, k));
      std::vector<PathPoint> ahead;
      for (Eigen::Index i = k + 1; i < std::min(n, k + 60); ++i) ahead.push_back(at(command, i));
      if (k < 10 || k >= n - 60) continue;
      EXPECT_NEAR(live.of(at(actual, k), ahead), whole.distance(k), 1e-12) << axes << ", " << k;
      PathPoint across = whole.away[static_cast<std::size_t>(k)];
      double square = 0.0;
      for (const double x : across) square += x * x;
      EXPECT_NEAR(std::sqrt(square), std::abs(whole.distance(k)), 1e-15);
    }
  }
}

TEST(ProgramError, KnowsTheWholePathHoweverLongItStood) {
  const Eigen::Index n = 4000;
  ArrayXd x = ArrayXd::Constant(n, 1e-3), y = ArrayXd::Zero(n);
  x.head(100) = ArrayXd::LinSpaced(100, 0.0, 1e-3);
  std::vector<ArrayXd> actual{x, y};
  actual[0](3999) = 0.5e-3, actual[1](3999) = -2e-6;
  const ProgramError error = program_error(std::vector<ArrayXd>{x, y}, actual);
  EXPECT_NEAR(error.distance(3999), 2e-6, 1e-15) << "right of the way it came";
  EXPECT_EQ(error.distance(2000), 0.0);
}

// The tool is turned by what the rotary axes miss at the same place, not at the same time.
TEST(ProgramError, OfRotaryAxesIsTakenAtTheSamePlace) {
  const Eigen::Index n = 500;
  const ArrayXd t = ArrayXd::LinSpaced(n, 0.0, 0.499);
  const std::vector<ArrayXd> command{0.1 * t, 0.0 * t}, rotary{0.5 * t, 0.2 * t};
  const double lag = 8e-3;  // of all axes alike
  std::vector<ArrayXd> actual{0.1 * (t - lag), 0.0 * t},
      turned{0.5 * (t - lag) + 3e-6, 0.2 * (t - lag) - 4e-6};
  const ProgramError same = program_error(command, actual, rotary, turned);
  for (Eigen::Index k = 20; k < n - 20; ++k) EXPECT_NEAR(same.turned(k), 5e-6, 1e-12) << k;
  // Linear axes that do not lag: now it is all error.
  const ProgramError unlike = program_error(command, command, rotary, turned);
  const double expected = std::hypot(0.5 * lag - 3e-6, 0.2 * lag + 4e-6);
  for (Eigen::Index k = 20; k < n - 20; ++k) EXPECT_NEAR(unlike.turned(k), expected, 1e-9) << k;
}

TEST(ProgramError, RefusesAxesOfUnlikeLength) {
  const std::vector<ArrayXd> two{ArrayXd::Zero(5), ArrayXd::Zero(6)}, one{ArrayXd::Zero(5)};
  EXPECT_THROW((void)program_error(two, two), std::invalid_argument);
  EXPECT_THROW((void)program_error(one, std::vector<ArrayXd>{}), std::invalid_argument);
  EXPECT_THROW((void)program_error(one, one, one, {}), std::invalid_argument);
}

// Friction on one axis of a line along X: all of what Y errs by is across the path.
TEST(ContourShares, NameTheAxisAndTheEffect) {
  Model x, y;
  x.sample_time_s = y.sample_time_s = 1e-3;
  for (Model* model : {&x, &y}) {
    model->loop.order = 2;
    model->loop.denominator = {92.1, 14412.0, 0.0};
    model->loop.numerator = {1.0, 92.1, 0.0};
  }
  Effect coulomb = make_effect<CoulombFriction>(), load = make_effect<ConstantForce>();
  coulomb.coefficient[0] = 0.2;
  load.coefficient[0] = 0.05;
  y.effects = {coulomb, load};
  Segment along, across;
  along.sample_time_s = across.sample_time_s = 1e-3;
  const ArrayXd t = ArrayXd::LinSpaced(2000, 0.0, 1.999);
  along.command = 0.02 * (3.0 * t).sin();
  across.command = 0.01 * (3.0 * t).sin();
  const std::vector<ArrayXd> command{along.command, across.command};
  const std::vector<ArrayXd> actual{along.command - simulate(x, along),
                                    across.command - simulate(y, across)};
  const ProgramError error = program_error(command, actual);
  const std::vector<ContourShare> shares = contour_shares({x, y}, {along, across}, error);
  ASSERT_EQ(shares.size(), 5U);
  EXPECT_EQ(shares[0].axis, 1U);
  EXPECT_EQ(shares[0].what, "coulomb_friction");
  EXPECT_GT(shares[0].share, 0.5);
  const auto held = std::find_if(shares.begin(), shares.end(), [](const ContourShare& share) {
    return share.what == "gravity_offset";
  });
  ASSERT_NE(held, shares.end());
  EXPECT_GT(held->share, 0.0);
  EXPECT_LT(held->share, shares[0].share);
  EXPECT_LT(std::abs(shares[4].share), 0.05) << "a line leaves no rest to speak of";
}

}  // namespace
}  // namespace servotwin
