#include "twin/hold.h"

#include <gtest/gtest.h>

#include <cmath>

#include "twin/two_pi.h"

namespace servotwin {
namespace {

// w' = -p w + u with u = u0 + u1 s: closed form.
TEST(Hold, FirstOrderLagOfARampIsTheClosedForm) {
  const double p = 37.0, h = 2e-3, w0 = 0.3, u0 = 1.7, u1 = -55.0;
  const Hold hold = discretise(Eigen::MatrixXd::Constant(1, 1, -p), Eigen::VectorXd::Ones(1), h, 1);
  const double decay = std::exp(-p * h);
  const double expected = decay * w0 + u0 * (1 - decay) / p + u1 * (h - (1 - decay) / p) / p;
  EXPECT_NEAR(hold.phi(0, 0) * w0 + hold.g(0, 0) * u0 + hold.g(0, 1) * u1, expected, 1e-15);
}

// Filter 1/P with poles 9.87 Hz, 31.31 Hz / 0.44 at 1 ms, driven by sin(2 pi 3 t)^3 t. Numbers from
// the project's reference study (an independent Python implementation; docs/theory.md 7).
class ThirdOrderFilter : public ::testing::Test {
 protected:
  ThirdOrderFilter() : input(1001) {
    for (Eigen::Index i = 0; i < input.size(); ++i) {
      const double t = static_cast<double>(i) * h;
      input(i) = std::pow(std::sin(kTwoPi * 3.0 * t), 3) * t;
    }
    companion << 0, 1, 0, 0, 0, 1, -2400064.3881402137, -49437.33150297439, -235.1343871135202;
  }
  const double h = 1e-3;
  Eigen::ArrayXd input;
  Eigen::Matrix3d companion;
  const Eigen::Vector3d unit{0, 0, 1};
};

void expect_relative(const Eigen::Vector3d& got, const Eigen::Vector3d& want) {
  for (int i = 0; i < 3; ++i)
    EXPECT_NEAR(got(i), want(i), 1e-10 * std::abs(want(i))) << "state " << i;
}

TEST_F(ThirdOrderFilter, FirstOrderHoldAgreesWithTheReference) {
  const Hold hold = discretise(companion, unit, h, 1);
  Eigen::Vector3d w = Eigen::Vector3d::Zero(), middle = w;
  for (Eigen::Index i = 0; i + 1 < input.size(); ++i) {
    if (i == 500) middle = w;
    w = (hold.phi * w + hold.g.col(0) * input(i) + hold.g.col(1) * (input(i + 1) - input(i)) / h)
            .eval();
  }
  expect_relative(middle, {1.9551715009305154e-08, -1.2858049668855326e-06, 8.109692178084538e-05});
  expect_relative(w, {-4.110531615627358e-08, 2.6982141819239668e-06, -0.00017065941447557857});
}

TEST_F(ThirdOrderFilter, CubicSplineHoldAgreesWithTheReference) {
  const Hold hold = discretise(companion, unit, h, 3);
  const Spline spline = Spline::through(input, h, 0.0, 0.0);
  Eigen::Vector3d w = Eigen::Vector3d::Zero(), middle = w;
  for (Eigen::Index i = 0; i + 1 < input.size(); ++i) {
    if (i == 500) middle = w;
    w = (hold.phi * w + hold.g.col(0) * spline.value(i) + hold.g.col(1) * spline.first(i) +
         hold.g.col(2) * spline.second(i) + hold.g.col(3) * spline.third(i))
            .eval();
  }
  expect_relative(middle, {1.95449559594141e-08, -1.285602671747697e-06, 8.112635294431922e-05});
  expect_relative(w, {-4.109109262396715e-08, 2.6977648963821054e-06, -0.0001707173240875547});
}

Eigen::ArrayXd cubic(Eigen::Index n, double h) {
  const Eigen::ArrayXd t = Eigen::ArrayXd::LinSpaced(n, 0.0, h * static_cast<double>(n - 1));
  return 0.2 + 1.5 * t - 3.0 * t.square() + 7.0 * t.cube();
}

TEST(Spline, ReproducesACubicAndItsDerivatives) {
  const double h = 0.01;
  const Spline spline = Spline::through(cubic(50, h), h);
  for (Eigen::Index i = 0; i < 50; ++i) {
    const double t = static_cast<double>(i) * h;
    EXPECT_NEAR(spline.first(i), 1.5 - 6.0 * t + 21.0 * t * t, 1e-10);
    EXPECT_NEAR(spline.second(i), -6.0 + 42.0 * t, 1e-8);
    if (i + 1 < 50) {
      EXPECT_NEAR(spline.third(i), 42.0, 1e-5);
    }
  }
}

TEST(Spline, DelaysACubicByAnyFraction) {
  const double h = 0.01;
  const Spline spline = Spline::through(cubic(50, h), h);
  for (double delay : {0.0, 0.004, 0.01, 0.0237}) {
    const Eigen::ArrayXd late = spline.delayed(delay);
    for (Eigen::Index i = 5; i < 50; ++i) {
      const double t = static_cast<double>(i) * h - delay;
      EXPECT_NEAR(late(i), 0.2 + 1.5 * t - 3.0 * t * t + 7.0 * t * t * t, 1e-12)
          << delay << " " << i;
    }
  }
}

TEST(Spline, ThroughTooFewSamplesStaysAtThem) {
  EXPECT_EQ(Spline::through(Eigen::ArrayXd::Constant(1, 3.0), 0.01).value(0), 3.0);
  const Spline two = Spline::through((Eigen::ArrayXd(2) << 1.0, 2.0).finished(), 0.5);
  EXPECT_EQ(two.first(0), 0.0);
  EXPECT_NEAR(two.delayed(0.25)(1), 1.5, 1e-15);
}

}  // namespace
}  // namespace servotwin
