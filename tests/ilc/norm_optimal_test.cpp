#include "ilc/norm_optimal.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <random>

#include "tests/ilc/study.h"

namespace servotwin {
namespace {

using Eigen::ArrayXd;
using Eigen::MatrixXd;

LearningLaw law_of(double bandwidth_hz, double weight = 1e-2) {
  LearningLaw law;
  law.law = Law::kNormOptimal;
  law.model = transfer_of(study::plant());
  law.bandwidth_hz = bandwidth_hz;
  law.weight = weight;
  return law;
}

ArrayXd bump(Eigen::Index n, double height) {
  const ArrayXd t = ArrayXd::LinSpaced(n, -1.0, 1.0);
  return height * (-(8.0 * t).square()).exp() * (20.0 * t).sin();
}

/// T as a matrix.
MatrixXd lifted(Eigen::Index n) {
  const ArrayXd impulse = impulse_response(transfer_of(study::plant()), study::kStep_s, n);
  MatrixXd out = MatrixXd::Zero(n, n);
  for (Eigen::Index k = 0; k < n; ++k) out.col(k).tail(n - k) = impulse.head(n - k);
  return out;
}

// Against the dense system, which has the limit of no Q.
TEST(NormOptimal, IsTheSolutionOfTheDenseSystem) {
  const Eigen::Index n = 300;
  const LearningLaw law = law_of(std::numeric_limits<double>::infinity());
  NormOptimal optimal(law, {}, n, study::kStep_s);
  const ArrayXd u = bump(n, 1e-4), e = bump(n, 2e-4).reverse();
  const ArrayXd found = optimal.next(u, e);
  const MatrixXd t = lifted(n).middleCols(1, n - 2);  // the ends are 0
  const MatrixXd system = t.transpose() * t + law.weight * MatrixXd::Identity(n - 2, n - 2);
  const Eigen::VectorXd right = (t.transpose() * (lifted(n) * u.matrix() + e.matrix())) +
                                law.weight * u.matrix().segment(1, n - 2);
  const Eigen::VectorXd expected = system.llt().solve(right);
  EXPECT_LT((found.matrix().segment(1, n - 2) - expected).norm(), 1e-7 * expected.norm());
  EXPECT_EQ(found(0), 0.0);
  EXPECT_EQ(found(n - 1), 0.0);
}

// Away from the ends it is the filter form, Q (u + L e).
TEST(NormOptimal, WithoutLimitsIsTheFilterForm) {
  const Eigen::Index n = 2000;
  const LearningLaw law = law_of(60.0);
  NormOptimal optimal(law, {}, n, study::kStep_s);
  const ArrayXd u = bump(n, 1e-4), e = bump(n, 2e-4).reverse();
  ZeroPhase filter(n, study::kStep_s);
  // T as the lifted form has it, with straight lines between the samples.
  const ArrayXd impulse = impulse_response(law.model, study::kStep_s, n);
  const Eigen::ArrayXcd expected_response = Eigen::ArrayXcd::Zero(filter.omega().size());
  const ArrayXd expected = [&] {
    Eigen::ArrayXcd q(filter.omega().size()), ql(filter.omega().size());
    for (Eigen::Index k = 0; k < q.size(); ++k) {
      const double w = filter.omega()(k);
      std::complex<double> t = 0.0;
      for (Eigen::Index i = 0; i < n; ++i)
        t += impulse(i) * std::polar(1.0, -w * study::kStep_s * static_cast<double>(i));
      const double beyond = std::pow(w / (2.0 * std::numbers::pi * 60.0), 4.0);
      const double all = std::norm(t) * (1.0 + beyond) + law.weight;
      q(k) = (std::norm(t) + law.weight) / all;
      ql(k) = std::conj(t) / all;
    }
    return ArrayXd(filter.filtered(u, q) + filter.filtered(e, ql));
  }();
  const ArrayXd found = optimal.next(u, e);
  EXPECT_LT((found - expected).abs().maxCoeff(), 1e-3 * expected.abs().maxCoeff());
}

TEST(NormOptimal, IsTheBestWithinTheLimitsAndObeysThem) {
  const Eigen::Index n = 600;
  const ArrayXd u = ArrayXd::Zero(n), e = bump(n, 2e-4);
  const LearningLaw law = law_of(60.0);
  NormOptimal free(law, {}, n, study::kStep_s);
  const ArrayXd wanted = free.next(u, e);
  const double h = study::kStep_s;
  const ArrayXd slope = (wanted.tail(n - 1) - wanted.head(n - 1)) / h;
  const CorrectionLimits limits{0.6 * wanted.abs().maxCoeff(), 0.5 * slope.abs().maxCoeff()};
  NormOptimal bound(law, limits, n, h);
  const ArrayXd found = bound.next(u, e);
  EXPECT_LE(found.abs().maxCoeff(), limits.peak);
  EXPECT_LE((found.tail(n - 1) - found.head(n - 1)).abs().maxCoeff(),
            limits.rate * h * (1.0 + 1e-12));
  const double cost = bound.cost(found, u, e);
  EXPECT_LT(cost, 0.95 * bound.cost(limited(wanted, limits, h), u, e)) << "than cutting it off";
  EXPECT_GT(cost, bound.cost(wanted, u, e)) << "the limits cost something";
  // No neighbour within the limits is better.
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> any(0.0, 1.0);
  for (int trial = 0; trial < 200; ++trial) {
    ArrayXd other = found;
    const auto at = static_cast<Eigen::Index>(1 + any(random) * static_cast<double>(n - 60));
    const auto wide = static_cast<Eigen::Index>(2 + any(random) * 50.0);
    other.segment(at, wide) += (any(random) - 0.5) * 0.2 * limits.peak;
    EXPECT_GE(bound.cost(limited(other, limits, h), u, e), cost * (1.0 - 2e-3));
  }
}

TEST(NormOptimal, ThinksOfTenThousandSamplesWithoutAMatrix) {
  const Eigen::Index n = 10'000;
  NormOptimal optimal(law_of(60.0), {}, n, 1e-3);
  const ArrayXd u = ArrayXd::Zero(n), e = bump(n, 2e-4);
  const ArrayXd found = optimal.next(u, e);
  EXPECT_LT(optimal.cost(found, u, e), 0.2 * e.square().sum());
}

TEST(Limits, HoldForAnySignalAndChangeNothingThatObeys) {
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal;
  const double h = 1e-3;
  for (int trial = 0; trial < 200; ++trial) {
    const CorrectionLimits limits{std::exp(normal(random)) * 1e-4, std::exp(normal(random)) * 1e-2};
    ArrayXd u(100 + trial);
    for (double& x : u) x = 1e-4 * normal(random);
    const ArrayXd within = limited(u, limits, h);
    EXPECT_LE(within.abs().maxCoeff(), limits.peak);
    const ArrayXd steps = within.tail(u.size() - 1) - within.head(u.size() - 1);
    EXPECT_LE(steps.abs().maxCoeff(), limits.rate * h * (1.0 + 1e-9));
    EXPECT_EQ(within(0), 0.0);
    EXPECT_EQ(within(u.size() - 1), 0.0);
    EXPECT_LT((limited(within, limits, h) - within).abs().maxCoeff(), 1e-15);
  }
}

}  // namespace
}  // namespace servotwin
