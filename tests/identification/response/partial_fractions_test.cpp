// Vector fitting alone, without the refinement, which could compensate its errors.
#include "identification/response/partial_fractions.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <cmath>

namespace servotwin {
namespace {

using Complex = std::complex<double>;

/// Two lightly damped pairs, one real pole and a constant.
ResponsePoints points_of(double sign_of_damping) {
  ResponsePoints out;
  out.omega = Eigen::ArrayXd::LinSpaced(200, 1.0, 60.0);
  out.response.resize(200, 1);
  for (Eigen::Index i = 0; i < 200; ++i) {
    const Complex s(0.0, out.omega(i));
    out.response(i, 0) = 0.3 + (0.2 * s + 100.0) / (s * s + sign_of_damping * 0.6 * s + 100.0) +
                         (s - 500.0) / (s * s + 1.2 * s + 900.0) + 4.0 / (s + 5.0);
  }
  out.deviation = Eigen::MatrixXd::Constant(200, 1, 0.01);
  return out;
}

/// Real poles first, then by frequency.
Factors sorted(Factors factors) {
  std::sort(factors.begin(), factors.end(), [](const Factor& l, const Factor& r) {
    return l.poles() != r.poles() ? l.poles() < r.poles() : l.b < r.b;
  });
  return factors;
}

Factors relocated_once(const WeightedResponse& p) {
  const Factors factors{pair_of(0.5, 0.01), pair_of(1.5, 0.01), {false, 0.0, 1.0}};
  return sorted(relocated(p, factors));
}

TEST(PartialFractions, OneRelocationFindsThePolesOfCleanPoints) {
  // sigma = product (s - pole) / product (s - start) solves the equations wherever it starts.
  const WeightedResponse p(points_of(1.0), {});
  const Factors factors = relocated_once(p);
  ASSERT_EQ(factors.size(), 3u);
  EXPECT_NEAR(factors[0].b * p.unit, 5.0, 1e-8);
  EXPECT_NEAR(factors[1].a * p.unit, 0.6, 1e-8);
  EXPECT_NEAR(factors[1].b * p.unit * p.unit, 100.0, 1e-6);
  EXPECT_NEAR(factors[2].a * p.unit, 1.2, 1e-8);
  EXPECT_NEAR(factors[2].b * p.unit * p.unit, 900.0, 1e-6);
  EXPECT_LT(residues_of(p, factors).cost, 1e-12);
}

TEST(PartialFractions, AnUnstablePoleIsMirrored) {
  // One step from the poles themselves finds them again, the unstable pair on the left.
  const WeightedResponse p(points_of(-1.0), {});
  Factors start{{true, 0.6 / p.unit, 100.0 / (p.unit * p.unit)},
                {true, 1.2 / p.unit, 900.0 / (p.unit * p.unit)},
                {false, 0.0, 5.0 / p.unit}};
  const Factors found = sorted(relocated(p, start));
  ASSERT_EQ(found.size(), 3u);
  EXPECT_NEAR(found[1].a * p.unit, 0.6, 1e-8);
  EXPECT_NEAR(found[1].b * p.unit * p.unit, 100.0, 1e-6);
}

TEST(PartialFractions, NoPairIsNarrowerThanALine) {
  const WeightedResponse p(points_of(1.0), {.least_width = 1.0});
  for (const Factor& factor : relocated_once(p)) {
    if (factor.pair) {
      EXPECT_GE(factor.a * p.unit, 1.0 - 1e-9);
    }
  }
}

}  // namespace
}  // namespace servotwin
