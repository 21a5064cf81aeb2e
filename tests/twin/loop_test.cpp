#include "twin/loop.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "twin/two_pi.h"

namespace servotwin {
namespace {

Loop loop_of(std::array<double, 3> a, int order) {
  Loop loop;
  loop.order = order;
  loop.denominator = a;
  return loop;
}

// p = 9.87 Hz, omega = 31.31 Hz, zeta = 0.44 expanded by hand (thesis 3.6).
TEST(Loop, PolesMakeTheKnownCoefficients) {
  const auto a = denominator_of({9.87 * kTwoPi, 31.31 * kTwoPi, 0.44}, 3);
  EXPECT_NEAR(a[0], 235.1343871135202, 1e-9);
  EXPECT_NEAR(a[1], 49437.33150297439, 1e-7);
  EXPECT_NEAR(a[2], 2400064.3881402137, 1e-5);
}

TEST(Loop, RootsAreZerosOfThePolynomial) {
  std::mt19937_64 rng{11};
  std::uniform_real_distribution<double> log_hz(std::log(0.5), std::log(900.0)), damping(0.05, 2.5);
  for (int round = 0; round < 2000; ++round) {
    const int order = 2 + round % 2;
    const PoleSet set{kTwoPi * std::exp(log_hz(rng)), kTwoPi * std::exp(log_hz(rng)), damping(rng)};
    const Loop loop = loop_of(denominator_of(set, order), order);
    SCOPED_TRACE(::testing::Message() << "p " << set.real << " omega " << set.omega << " zeta "
                                      << set.zeta << " order " << order);
    EXPECT_TRUE(stable(loop));
    const auto roots = roots_of(loop);
    std::complex<double> sum = 0.0, product = 1.0;
    for (int i = 0; i < order; ++i) {
      const auto r = roots[static_cast<std::size_t>(i)];
      sum += r;
      product *= -r;
      EXPECT_LT(r.real(), 0.0);
    }
    const double an = loop.denominator[static_cast<std::size_t>(order - 1)];
    EXPECT_NEAR(-sum.real(), loop.denominator[0], 1e-8 * loop.denominator[0]);
    EXPECT_NEAR(product.real(), an, 1e-8 * an);
    // One of the labels is the one we started from.
    const PoleLabels labels = labels_of(loop);
    EXPECT_EQ(labels.count, order == 3 && set.zeta > 1.0 ? 3 : 1);
    double nearest = 1e300;
    for (int i = 0; i < labels.count; ++i) {
      const PoleSet& named = labels.set[static_cast<std::size_t>(i)];
      double d = std::abs(named.omega / set.omega - 1.0) + std::abs(named.zeta / set.zeta - 1.0);
      if (order == 3) d += std::abs(named.real / set.real - 1.0);
      nearest = std::min(nearest, d);
    }
    EXPECT_LT(nearest, 1e-5);
  }
}

TEST(Loop, StabilityIsRouthHurwitz) {
  EXPECT_TRUE(stable(loop_of({3, 3, 1}, 3)));
  EXPECT_FALSE(stable(loop_of({1, 1, 2}, 3)));  // a1 a2 < a3
  EXPECT_FALSE(stable(loop_of({3, 3, -1}, 3)));
  EXPECT_FALSE(stable(loop_of({3, 3, 0}, 3)));
  EXPECT_TRUE(stable(loop_of({1, 1, 0}, 2)));
  EXPECT_FALSE(stable(loop_of({-1, 1, 0}, 2)));
  EXPECT_FALSE(stable(loop_of({std::nan(""), 1, 0}, 2)));
}

}  // namespace
}  // namespace servotwin
