#include "daemon/between/histogram.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>
#include <vector>

namespace servotwin::daemon {
namespace {

TEST(Histogram, WithoutValuesHasNoQuantile) {
  const Histogram histogram;
  EXPECT_TRUE(std::isnan(histogram.quantile_s(0.5)));
  EXPECT_EQ(histogram.max_s(), 0.0);
}

TEST(Histogram, QuantilesAreAtMostAnEighthAboveTheTrueOnes) {
  std::mt19937_64 random(20);
  std::lognormal_distribution<> times(9.0, 2.0);  // ns: from some to some millions
  Histogram histogram;
  std::vector<double> all;
  for (int i = 0; i < 20'000; ++i) {
    const auto ns = static_cast<std::int64_t>(times(random));
    histogram.add(ns);
    all.push_back(static_cast<double>(ns) * 1e-9);
  }
  std::sort(all.begin(), all.end());
  for (const double q : {0.001, 0.01, 0.5, 0.9, 0.99, 0.999, 1.0}) {
    const double truth = all[static_cast<std::size_t>(std::ceil(q * 20'000)) - 1];
    EXPECT_GE(histogram.quantile_s(q), truth) << q;
    EXPECT_LE(histogram.quantile_s(q), 1.125 * truth + 1e-9) << q;
  }
  EXPECT_DOUBLE_EQ(histogram.max_s(), all.back());
}

TEST(Histogram, TakesAnyTimeThatAClockCanGive) {
  Histogram histogram;
  for (const std::int64_t ns : {INT64_MIN, std::int64_t{-1}, std::int64_t{0}, INT64_MAX})
    histogram.add(ns);
  EXPECT_EQ(histogram.quantile_s(0.5), 0.0);
  EXPECT_GT(histogram.quantile_s(1.0), 1000.0);
}

}  // namespace
}  // namespace servotwin::daemon
