// The CUSUM against published tables, the exact integral equation, and simulation.
#include "diagnosis/statistics/cusum.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <numbers>
#include <random>
#include <stdexcept>

namespace servotwin {
namespace {

double normal_density(double x) {
  return std::exp(-0.5 * x * x) / std::sqrt(2.0 * std::numbers::pi);
}
double normal_distribution(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }

/// The average run length from S = 0 without any approximation (Page 1954):
///   L(u) = 1 + L(0) P(z <= k - u) + integral of L(s) p(s - u + k) over 0..h
/// with Gauss's rule of two points on 400 intervals.
double exact_run_length(double drift, double threshold, double mean) {
  constexpr int kIntervals = 400, kPoints = 2 * kIntervals;
  const double width = threshold / kIntervals;
  Eigen::VectorXd place(kPoints + 1);
  for (int i = 0; i < kIntervals; ++i) {
    const double middle = (i + 0.5) * width, off = 0.5 * width / std::sqrt(3.0);
    place(2 * i) = middle - off;
    place(2 * i + 1) = middle + off;
  }
  place(kPoints) = 0.0;
  Eigen::MatrixXd a = Eigen::MatrixXd::Identity(kPoints + 1, kPoints + 1);
  for (int row = 0; row <= kPoints; ++row) {
    for (int column = 0; column < kPoints; ++column)
      a(row, column) -= 0.5 * width * normal_density(place(column) - place(row) + drift - mean);
    a(row, kPoints) -= normal_distribution(drift - place(row) - mean);
  }
  return a.partialPivLu().solve(Eigen::VectorXd::Ones(kPoints + 1))(kPoints);
}

double simulated_run_length(double drift, double threshold, double mean, int runs) {
  std::mt19937_64 random(20);
  std::normal_distribution<> normal(mean);
  double steps = 0.0;
  for (int run = 0; run < runs; ++run) {
    Cusum cusum(drift, threshold);
    do {
      ++steps;
    } while (!cusum.add(normal(random)));
  }
  return steps / runs;
}

struct Published {
  double mean, run_length_h4, run_length_h5;
};
// Montgomery, Introduction to Statistical Quality Control, table 9.3 (after Lucas): two-sided,
// k = 1/2. For two equal sides the sum of 1/ARL counts; far from 0 only one side ever alarms.
constexpr Published kTable[] = {{1.0, 8.38, 10.4}, {1.5, 4.75, 5.75}, {2.0, 3.34, 4.01}};

TEST(CusumClosedForm, IsWithinFivePercentOfThePublishedTable) {
  for (const Published& one : kTable) {
    EXPECT_NEAR(average_run_length(0.5, 4.0, one.mean), one.run_length_h4,
                0.05 * one.run_length_h4);
    EXPECT_NEAR(average_run_length(0.5, 5.0, one.mean), one.run_length_h5,
                0.05 * one.run_length_h5);
  }
  EXPECT_NEAR(0.5 * average_run_length(0.5, 4.0), 168.0, 0.05 * 168.0);
  EXPECT_NEAR(0.5 * average_run_length(0.5, 5.0), 465.0, 0.05 * 465.0);
}

TEST(CusumClosedForm, IsWithinTwoPercentOfTheIntegralEquationWhereTheDaemonWorks) {
  // One false alarm in 30 days of one-second intervals, and the delay until an increase is
  // detected.
  const double threshold = threshold_for(0.5, 30.0 * 86400.0);
  EXPECT_NEAR(exact_run_length(0.5, threshold, 0.0) / (30.0 * 86400.0), 1.0, 0.02);
  for (const double mean : {0.75, 1.0, 1.5}) {
    EXPECT_NEAR(average_run_length(0.5, threshold, mean) / exact_run_length(0.5, threshold, mean),
                1.0, 0.02)
        << mean;
  }
  EXPECT_NEAR(exact_run_length(0.5, 4.0, 1.0), 8.38, 0.01) << "the reference value from the table";
}

TEST(CusumClosedForm, WithoutADriftOfTheSumItIsTheSquareOfTheThreshold) {
  EXPECT_NEAR(average_run_length(0.5, 5.0, 0.5), 6.166 * 6.166, 1e-9);
  EXPECT_NEAR(average_run_length(0.5, 5.0, 0.5 + 1e-5) / average_run_length(0.5, 5.0, 0.5), 1.0,
              1e-4);
}

TEST(CusumClosedForm, TheThresholdIsTheInverse) {
  for (const double drift : {0.1, 0.5, 1.0, 2.0}) {
    for (const double run_length : {1e2, 1e4, 2.592e6, 1e9}) {
      const double threshold = threshold_for(drift, run_length);
      EXPECT_NEAR(average_run_length(drift, threshold) / run_length, 1.0, 1e-9);
    }
  }
  EXPECT_EQ(threshold_for(2.0, 10.0), 0.0) << "rare enough without a threshold";
}

TEST(Cusum, RunsAsLongAsTheClosedFormSays) {
  EXPECT_NEAR(simulated_run_length(0.5, 4.0, 0.0, 4000) / average_run_length(0.5, 4.0), 1.0, 0.05);
  const double threshold = threshold_for(0.5, 2000.0);
  EXPECT_NEAR(simulated_run_length(0.5, threshold, 0.0, 2000) / 2000.0, 1.0, 0.07);
  EXPECT_NEAR(
      simulated_run_length(0.5, threshold, 1.0, 4000) / average_run_length(0.5, threshold, 1.0),
      1.0, 0.03);
}

TEST(Cusum, EndsTheAlarmWhenTheSumIsBackAtZero) {
  Cusum cusum(0.5, 4.0);
  EXPECT_FALSE(cusum.add(4.0));  // S = 3.5
  EXPECT_TRUE(cusum.add(1.5));   // 4.5: limited to 4
  EXPECT_TRUE(cusum.add(1000.0));
  EXPECT_EQ(cusum.sum(), 4.0) << "S was limited and need not fall from 1000";
  for (int i = 0; i < 7; ++i) EXPECT_TRUE(cusum.add(0.0)) << i;
  EXPECT_FALSE(cusum.add(0.0));
  EXPECT_EQ(cusum.sum(), 0.0);
}

TEST(Cusum, LeavesOutWhatIsNotANumber) {
  Cusum cusum(0.5, 4.0);
  (void)cusum.add(3.0);
  const double before = cusum.sum();
  for (const double bad : {std::nan(""), HUGE_VAL, -HUGE_VAL}) {
    EXPECT_FALSE(cusum.add(bad));
    EXPECT_EQ(cusum.sum(), before);
  }
}

TEST(SteadyLevel, OfIndependentValuesIsMeanAndStandardDeviation) {
  std::mt19937_64 random(20);
  std::normal_distribution<> normal(3.0, 2.0);
  std::vector<double> values(20'000);
  for (double& value : values) value = normal(random);
  const SteadyLevel level = level_of(values, 0);
  EXPECT_NEAR(level.mean, 3.0, 0.05);
  EXPECT_NEAR(level.deviation, 2.0, 0.04);
  EXPECT_NEAR(level.mean_error, 2.0 / std::sqrt(20'000.0), 0.001);
}

TEST(SteadyLevel, OfAnAutoregressionIsItsLongRunDeviation) {
  // y_j = a y_(j-1) + w: the sum of n of them has the variance n / (1 - a)^2.
  std::mt19937_64 random(20);
  std::normal_distribution<> normal;
  std::vector<double> values(100'000);
  double y = 0.0;
  for (double& value : values) value = y = 0.5 * y + normal(random);
  EXPECT_NEAR(level_of(values, 40).deviation, 2.0, 0.1);
  EXPECT_NEAR(level_of(values, 0).deviation, 1.0 / std::sqrt(0.75), 0.02);
}

TEST(SteadyLevel, OfASwingIsNotLessThanItsDeviation) {
  std::vector<double> values(1000);
  for (std::size_t i = 0; i < values.size(); ++i) values[i] = i % 2 == 0 ? 1.0 : -1.0;
  EXPECT_NEAR(level_of(values, 10).deviation, 1.0, 1e-3)
      << "the sum of such a sequence does not grow";
}

TEST(SteadyLevel, ItsErrorsAreThoseOfRepetition) {
  std::mt19937_64 random(20);
  std::normal_distribution<> normal;
  constexpr int kTimes = 400;
  double means = 0.0, mean_errors = 0.0, variances = 0.0, squares = 0.0, told = 0.0;
  for (int time = 0; time < kTimes; ++time) {
    std::vector<double> values(900);
    double y = 0.0;
    for (double& value : values) value = y = 0.5 * y + normal(random);
    const SteadyLevel level = level_of(values, 20);
    means += level.mean * level.mean / kTimes;
    mean_errors += level.mean_error * level.mean_error / kTimes;
    variances += level.deviation * level.deviation / kTimes;
    squares += std::pow(level.deviation, 4.0) / kTimes;
    told = level.variance_error;
  }
  EXPECT_NEAR(std::sqrt(mean_errors / means), 1.0, 0.12);
  const double seen = std::sqrt(squares - variances * variances) / variances;
  EXPECT_NEAR(told / seen, 1.0, 0.2);
}

TEST(Cusum, OptionsThatMakeNoSenseAreRefused) {
  EXPECT_THROW((void)threshold_for(0.0, 100.0), std::invalid_argument);
  EXPECT_THROW((void)threshold_for(0.5, -1.0), std::invalid_argument);
  EXPECT_THROW((void)threshold_for(0.5, std::nan("")), std::invalid_argument);
  EXPECT_THROW((void)average_run_length(-0.5, 4.0), std::invalid_argument);
  EXPECT_THROW((void)level_of({1.0, 2.0}, 0), std::invalid_argument);
}

}  // namespace
}  // namespace servotwin
