// Long computations end when they are asked to, whoever does their pieces.
#include "identification/least_squares/interruption.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cstddef>

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
