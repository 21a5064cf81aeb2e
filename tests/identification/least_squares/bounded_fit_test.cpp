// Least squares within bounds: against all sets of parameters at their bounds, against published
// problems, and where residuals do not exist everywhere.
#include "identification/least_squares/bounded_fit.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace servotwin {
namespace {

constexpr double kInfinite = std::numeric_limits<double>::infinity();

double value_of(const Eigen::MatrixXd& h, const Eigen::VectorXd& g, const Eigen::VectorXd& s) {
  return 0.5 * s.dot(h * s) + g.dot(s);
}

/// The least value within the bounds, from every choice of free, lower and upper parameters.
double least_of_all_sets(const Eigen::MatrixXd& h, const Eigen::VectorXd& g,
                         const Eigen::VectorXd& lower, const Eigen::VectorXd& upper) {
  const auto n = static_cast<int>(g.size());
  double least = kInfinite;
  for (int set = 0; set < static_cast<int>(std::pow(3, n)); ++set) {
    Eigen::VectorXd s(n);
    std::vector<Eigen::Index> free;
    for (int i = 0, digits = set; i < n; ++i, digits /= 3) {
      if (digits % 3 == 0) free.push_back(i);
      s(i) = digits % 3 == 1 ? lower(i) : digits % 3 == 2 ? upper(i) : 0.0;
    }
    if (!free.empty()) {
      const Eigen::VectorXd rest = h * s + g;
      s(free) = -Eigen::MatrixXd(h(free, free)).fullPivLu().solve(Eigen::VectorXd(rest(free)));
    }
    if ((s.array() >= lower.array()).all() && (s.array() <= upper.array()).all())
      least = std::min(least, value_of(h, g, s));
  }
  return least;
}

TEST(QuadraticMinimum, IsTheBestOfAllSetsOfParametersAtTheirBounds) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> near(0.0, 0.7);
  for (int round = 0; round < 300; ++round) {
    const Eigen::Index n = 2 + round % 5;
    const auto draw = [&] { return normal(random); };
    const Eigen::MatrixXd a = Eigen::MatrixXd::NullaryExpr(n + 1, n, draw);
    const Eigen::MatrixXd h = a.transpose() * a + 1e-3 * Eigen::MatrixXd::Identity(n, n);
    const Eigen::VectorXd g = Eigen::VectorXd::NullaryExpr(n, draw);
    // Some begin at their bound, and some have one on one side only.
    Eigen::VectorXd lower(n), upper(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      lower(i) = i % 3 == 0 ? 0.0 : -near(random);
      upper(i) = i % 3 == 1 ? 0.0 : near(random);
    }
    const Eigen::VectorXd s = quadratic_minimum(h, g, lower, upper);
    EXPECT_TRUE((s.array() >= lower.array()).all() && (s.array() <= upper.array()).all());
    const double least = least_of_all_sets(h, g, lower, upper);
    EXPECT_NEAR(value_of(h, g, s), least, 1e-9 * (1.0 + std::abs(least))) << round;
  }
}

/// Rosenbrock's valley: 10 (y - x^2), 1 - x.
BoundedProblem valley(double most_x) {
  BoundedProblem out{
      Eigen::Vector2d(-kInfinite, -kInfinite), Eigen::Vector2d(most_x, kInfinite), {}};
  out.evaluate = [](const Eigen::VectorXd& x, Eigen::VectorXd& r, Eigen::MatrixXd* by) {
    r = Eigen::Vector2d(10.0 * (x(1) - x(0) * x(0)), 1.0 - x(0));
    if (by != nullptr) {
      by->resize(2, 2);
      *by << -20.0 * x(0), 10.0, -1.0, 0.0;
    }
    return true;
  };
  return out;
}

TEST(FitWithin, FollowsAValleyToItsEndAndToABound) {
  Eigen::VectorXd x = Eigen::Vector2d(-1.2, 1.0);
  ASSERT_TRUE(fit_within(valley(kInfinite), {100, 1e-12}, x));
  EXPECT_NEAR(x(0), 1.0, 1e-6);
  EXPECT_NEAR(x(1), 1.0, 1e-6);
  x = Eigen::Vector2d(-1.2, 1.0);
  ASSERT_TRUE(fit_within(valley(0.5), {100, 1e-12}, x));
  EXPECT_EQ(x(0), 0.5);
  EXPECT_NEAR(x(1), 0.25, 1e-6);
  x = Eigen::Vector2d(7.0, 1.0);
  ASSERT_TRUE(fit_within(valley(0.5), {100, 1e-12}, x)) << "a start beyond the bound";
  EXPECT_NEAR(x(1), 0.25, 1e-6);
}

// The full step from here, cut off at the bound of the first parameter, lets the cost rise.
TEST(FitWithin, AParameterAtItsBoundDoesNotStopTheOthers) {
  Eigen::MatrixXd a(2, 2);
  a << 1.0, 0.999, 0.0, 0.02;
  BoundedProblem problem{
      Eigen::Vector2d(0.0, -kInfinite), Eigen::Vector2d(kInfinite, kInfinite), {}};
  problem.evaluate = [&](const Eigen::VectorXd& x, Eigen::VectorXd& r, Eigen::MatrixXd* by) {
    r = a * x - Eigen::Vector2d(1.0, 0.1);
    if (by != nullptr) *by = a;
    return true;
  };
  Eigen::VectorXd x = Eigen::Vector2d::Zero();
  ASSERT_TRUE(fit_within(problem, {30, 1e-12}, x));
  // With the first at 0: a line fit of the second alone.
  const Eigen::Vector2d line = a.col(1);
  EXPECT_EQ(x(0), 0.0);
  EXPECT_NEAR(x(1), line.dot(Eigen::Vector2d(1.0, 0.1)) / line.squaredNorm(), 1e-6);
}

TEST(FitWithin, EndsWhereNothingIsFreeOrNothingActs) {
  BoundedProblem problem{Eigen::Vector2d(3.0, 1.0), Eigen::Vector2d(3.0, 1.0), {}};
  int evaluations = 0;
  double acts = 1.0;
  problem.evaluate = [&](const Eigen::VectorXd& x, Eigen::VectorXd& r, Eigen::MatrixXd* by) {
    ++evaluations;
    r = acts * x;
    if (by != nullptr) *by = acts * Eigen::Matrix2d::Identity();
    return true;
  };
  Eigen::VectorXd x = Eigen::Vector2d(3.0, 1.0);
  EXPECT_TRUE(fit_within(problem, {1000, 1e-9}, x));
  EXPECT_EQ(x, Eigen::Vector2d(3.0, 1.0)) << "both bounds of each are the same";
  problem.lower.setConstant(-kInfinite), problem.upper.setConstant(kInfinite);
  acts = 0.0;
  EXPECT_TRUE(fit_within(problem, {1000, 1e-9}, x));
  EXPECT_LT(evaluations, 10);
}

TEST(FitWithin, AvoidsPointsThatHaveNoResidual) {
  BoundedProblem problem{
      Eigen::VectorXd::Constant(1, -kInfinite), Eigen::VectorXd::Constant(1, kInfinite), {}};
  problem.evaluate = [](const Eigen::VectorXd& x, Eigen::VectorXd& r, Eigen::MatrixXd* by) {
    if (!(x(0) > 0.0)) return false;
    r = Eigen::VectorXd::Constant(1, std::log(x(0)) + 3.0);
    if (by != nullptr) *by = Eigen::MatrixXd::Constant(1, 1, 1.0 / x(0));
    return true;
  };
  Eigen::VectorXd x = Eigen::VectorXd::Constant(1, 2.0);
  ASSERT_TRUE(fit_within(problem, {60, 1e-14}, x)) << "the first full step leads below 0";
  EXPECT_NEAR(x(0), std::exp(-3.0), 1e-6);
  x(0) = -1.0;
  EXPECT_FALSE(fit_within(problem, {60, 1e-14}, x));
  EXPECT_EQ(x(0), -1.0);
}

}  // namespace
}  // namespace servotwin
