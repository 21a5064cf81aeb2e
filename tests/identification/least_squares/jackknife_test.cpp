// Leave-one-block-out fits by one step, against fits that leave the block out.
#include "identification/least_squares/jackknife.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

namespace servotwin {
namespace {

TEST(Jackknife, OfALinearProblemIsTheRefitWithoutTheBlock) {
  constexpr Eigen::Index kRows = 60, kBlocks = 4, kColumns = 3;
  std::mt19937_64 rng{5};
  std::normal_distribution<double> normal;
  Eigen::MatrixXd a(kRows * kBlocks, kColumns);
  Eigen::VectorXd b(kRows * kBlocks);
  for (double& value : a.reshaped()) value = normal(rng);
  a.col(1) *= 1e6;  // parameters in units of any size
  for (double& value : b) value = normal(rng);
  const Eigen::VectorXd all = a.householderQr().solve(b);
  std::vector<NormalEquations> blocks;
  for (Eigen::Index k = 0; k < kBlocks; ++k) {
    const Eigen::MatrixXd rows = a.middleRows(k * kRows, kRows);
    // From elsewhere than the optimum, too: the step is that of the whole refit.
    blocks.push_back(normal_equations(rows, rows * all - b.segment(k * kRows, kRows)));
  }
  const std::vector<Eigen::VectorXd> steps = steps_without_each(blocks);
  ASSERT_EQ(steps.size(), 4U);
  for (Eigen::Index k = 0; k < kBlocks; ++k) {
    Eigen::MatrixXd rest(kRows * (kBlocks - 1), kColumns);
    Eigen::VectorXd of_rest(kRows * (kBlocks - 1));
    rest << a.topRows(k * kRows), a.bottomRows((kBlocks - 1 - k) * kRows);
    of_rest << b.head(k * kRows), b.tail((kBlocks - 1 - k) * kRows);
    const Eigen::VectorXd refit = rest.householderQr().solve(of_rest);
    const Eigen::VectorXd step = refit - all;
    for (Eigen::Index c = 0; c < kColumns; ++c)
      EXPECT_NEAR(steps[static_cast<std::size_t>(k)](c), step(c), 1e-3 * std::abs(step(c)));
  }
}

TEST(Jackknife, WhatTheOtherBlocksDoNotShowStaysAsItIs) {
  // The second parameter acts in the first block alone.
  Eigen::MatrixXd first(2, 2), other(2, 2);
  first << 1.0, 1.0, 1.0, -1.0;
  other << 1.0, 0.0, 2.0, 0.0;
  const std::vector<Eigen::VectorXd> steps =
      steps_without_each({normal_equations(first, Eigen::Vector2d(0.3, -0.1)),
                          normal_equations(other, Eigen::Vector2d(0.1, -0.1))});
  EXPECT_DOUBLE_EQ(steps[0](1), 0.0);
  EXPECT_NEAR(steps[0](0), 0.1 / 5.0, 1e-4);
  EXPECT_TRUE(steps_without_each({}).empty());
}

}  // namespace
}  // namespace servotwin
