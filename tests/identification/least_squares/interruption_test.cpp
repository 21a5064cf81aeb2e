// Long computations end when they are asked to, whoever does their pieces.
#include "identification/least_squares/interruption.h"

#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstddef>
#include <stdexcept>
#include <utility>

#include "identification/least_squares/bounded.h"
#include "identification/least_squares/bounded_fit.h"
#include "identification/least_squares/parallel.h"

namespace servotwin {
namespace {

/// Rosenbrock's valley, which takes tens of rounds; counts what is evaluated.
BoundedProblem valley(int& evaluations, std::stop_source* stop_at_third) {
  BoundedProblem out;
  out.lower = Eigen::VectorXd::Constant(2, -1e300), out.upper = -out.lower;
  out.evaluate = [&evaluations, stop_at_third](const Eigen::VectorXd& x, Eigen::VectorXd& residual,
                                               Eigen::MatrixXd* jacobian) {
    if (++evaluations == 3 && stop_at_third != nullptr) stop_at_third->request_stop();
    residual = Eigen::Vector2d(10.0 * (x(1) - x(0) * x(0)), 1.0 - x(0));
    if (jacobian != nullptr)
      *jacobian = (Eigen::Matrix2d() << -20.0 * x(0), 10.0, -1.0, 0.0).finished();
    return true;
  };
  return out;
}

TEST(Interruption, EndsAFitBeforeItsNextRound) {
  Eigen::VectorXd x = Eigen::Vector2d(-1.2, 1.0);
  int evaluations = 0;
  ASSERT_TRUE(fit_within(valley(evaluations, nullptr), {100, 1e-12}, x));
  ASSERT_GT(evaluations, 20) << "it must have something to end";
  std::stop_source source;
  const Interruptible until(source.get_token());
  x = Eigen::Vector2d(-1.2, 1.0);
  evaluations = 0;
  EXPECT_THROW(fit_within(valley(evaluations, &source), {100, 1e-12}, x), Interrupted);
  EXPECT_LE(evaluations, 4);
}

/// The same valley for Ceres.
struct Valley final : ceres::SizedCostFunction<2, 2> {
  explicit Valley(std::stop_source* source) : stop_at_third(source) {}
  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    if (++evaluations == 3 && stop_at_third != nullptr) stop_at_third->request_stop();
    const double a = x[0][0], b = x[0][1];
    residuals[0] = 10.0 * (b - a * a), residuals[1] = 1.0 - a;
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      const std::array by{-20.0 * a, 10.0, -1.0, 0.0};
      std::copy(by.begin(), by.end(), jacobians[0]);
    }
    return true;
  }
  std::stop_source* stop_at_third;
  mutable int evaluations = 0;
};

/// Evaluations until the end, or until it is interrupted.
std::pair<bool, int> in_valley(std::stop_source* stop_at_third) {
  ceres::Problem problem;
  auto* valley = new Valley(stop_at_third);  // the problem's
  std::array x{-1.2, 1.0};
  problem.AddResidualBlock(valley, nullptr, x.data());
  try {
    solve_bounded(bounded_options(ceres::DENSE_QR, 100, 1e-12), problem);
  } catch (const Interrupted&) {
    return {true, valley->evaluations};
  }
  return {false, valley->evaluations};
}

TEST(Interruption, OfASearchOfCeresIsNoFailureOfTheData) {
  const auto [interrupted, evaluations] = in_valley(nullptr);
  EXPECT_FALSE(interrupted);
  ASSERT_GT(evaluations, 10) << "it must have something to end";
  std::stop_source source;
  const Interruptible until(source.get_token());
  const auto [ended, few] = in_valley(&source);
  EXPECT_TRUE(ended);
  EXPECT_LE(few, 5);
}

TEST(Interruption, ComesBeforeWhatThePiecesThrow) {
  use_threads(3);
  std::stop_source source;
  {
    const Interruptible until(source.get_token());
    EXPECT_THROW(in_parallel(3,
                             [&](std::size_t) {
                               source.request_stop();
                               throw std::runtime_error("no solution");
                             }),
                 Interrupted);
  }
  use_threads(1);
}

TEST(Interruption, ReachesTheThreadsThatDoThePieces) {
  use_threads(3);
  std::stop_source source;
  std::atomic<int> done = 0;
  {
    const Interruptible until(source.get_token());
    EXPECT_THROW(in_parallel(1000,
                             [&](std::size_t) {
                               source.request_stop();
                               ++done;
                             }),
                 Interrupted);
  }
  use_threads(1);
  EXPECT_LE(done, 3) << "one piece for every thread";
}

TEST(Interruption, EndsWithItsScope) {
  std::stop_source source;
  source.request_stop();
  {
    const Interruptible outer(source.get_token());
    {
      const Interruptible inner{std::stop_token()};
      EXPECT_NO_THROW(throw_if_interrupted());
    }
    EXPECT_THROW(throw_if_interrupted(), Interrupted);
  }
  EXPECT_NO_THROW(throw_if_interrupted());
}

}  // namespace
}  // namespace servotwin
