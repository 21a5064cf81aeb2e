// Low-pass filters against their defining gains.
#include "twin/low_pass.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <numbers>
#include <utility>

namespace servotwin {
namespace {

/// Gain and phase of a sine that went through, from its middle.
struct Passed {
  double gain = 0.0, phase = 0.0;
};
Passed passed(const LowPass& filter, double frequency) {
  const Eigen::Index n = 20'000;
  const Eigen::ArrayXd angle =
      2.0 * std::numbers::pi * frequency * Eigen::ArrayXd::LinSpaced(n, 0, n - 1);
  const Eigen::ArrayXd y = zero_phase(filter, angle.sin());
  const auto middle = Eigen::seqN(n / 4, n / 2);
  Eigen::MatrixXd basis(n / 2, 2);
  basis << angle.sin()(middle).matrix(), angle.cos()(middle).matrix();
  const Eigen::VectorXd c = basis.colPivHouseholderQr().solve(y(middle).matrix());
  return {c.norm(), std::atan2(c(1), c(0))};
}

TEST(LowPass, ButterworthHalvesTheAmplitudeAtItsCutoffWithoutPhase) {
  for (const int order : {2, 4, 8}) {
    const LowPass filter = butterworth(order, 0.1);
    const Passed at = passed(filter, 0.1);
    EXPECT_NEAR(at.gain, 0.5, 1e-6) << order;
    EXPECT_NEAR(at.phase, 0.0, 1e-6);
    // |H|^2 = 1 / (1 + (tan(pi f) / tan(pi fc))^(2 n)), as the bilinear transform bends it.
    const double ratio = std::tan(std::numbers::pi * 0.15) / std::tan(std::numbers::pi * 0.1);
    EXPECT_NEAR(passed(filter, 0.15).gain, 1.0 / (1.0 + std::pow(ratio, 2 * order)), 1e-6);
  }
}

TEST(LowPass, ChebyshevStaysWithinItsRippleUpToTheCutoffAndFallsBeyond) {
  const double ripple = 0.05;
  const LowPass filter = chebyshev(8, ripple, 0.04);
  const double most = std::pow(10.0, 2.0 * ripple / 20.0);  // filtered twice, 1 at rest
  EXPECT_NEAR(passed(filter, 0.04).gain, 1.0, 1e-6);
  double highest = 0.0;
  for (double f = 0.001; f < 0.04; f += 0.0005) {
    const double gain = passed(filter, f).gain;
    EXPECT_GE(gain, 1.0 - 1e-6) << f;
    EXPECT_LE(gain, most + 1e-6) << f;
    highest = std::max(highest, gain);
  }
  EXPECT_NEAR(highest, most, 2e-4);
  EXPECT_LT(passed(filter, 0.08).gain, 1e-6);
}

TEST(LowPass, LeavesAConstantAndARampAloneUpToTheEnds) {
  const Eigen::ArrayXd ramp = 3.0 + 0.25 * Eigen::ArrayXd::LinSpaced(300, 0.0, 299.0);
  EXPECT_LT((zero_phase(chebyshev(8, 0.05, 0.2), Eigen::ArrayXd::Constant(300, 7.0)) - 7.0)
                .abs()
                .maxCoeff(),
            1e-11);
  EXPECT_LT((zero_phase(butterworth(4, 0.2), ramp) - ramp).abs().maxCoeff(), 1e-3);
}

/// The sections one behind the other, as the header says; both passes, with the reflection.
Eigen::ArrayXd section_by_section(const LowPass& filter, const Eigen::ArrayXd& x) {
  const Eigen::Index n = x.size(), pad = 6 * static_cast<Eigen::Index>(filter.size());
  Eigen::ArrayXd y(n + 2 * pad);
  y << 2.0 * x(0) - x.segment(1, pad).reverse(), x,
      2.0 * x(n - 1) - x.segment(n - 1 - pad, pad).reverse();
  for (int pass = 0; pass < 2; ++pass) {
    for (const FilterSection& s : filter) {
      const double gain = (1.0 + s.a1 + s.a2) / 4.0;
      double u1 = y(0), u2 = y(0), y1 = y(0), y2 = y(0);
      for (double& value : y) {
        const double u = value;
        value = gain * (u + 2.0 * u1 + u2) - s.a1 * y1 - s.a2 * y2;
        u2 = std::exchange(u1, u), y2 = std::exchange(y1, value);
      }
    }
    y.reverseInPlace();
  }
  return y.segment(pad, n);
}

TEST(LowPass, IsItsSectionsOneBehindTheOther) {
  const Eigen::ArrayXd angle = Eigen::ArrayXd::LinSpaced(400, 0.0, 60.0);
  const Eigen::ArrayXd x = (angle.square() / 30.0).sin() + 0.1 * angle;
  for (int order = 2; order <= 18; order += 2) {
    const LowPass filter = butterworth(order, 0.15);
    EXPECT_LT((zero_phase(filter, x) - section_by_section(filter, x)).abs().maxCoeff(), 1e-11)
        << order;
  }
}

TEST(LowPass, RefusesWhatIsNoFilter) {
  EXPECT_THROW((void)butterworth(3, 0.1), std::invalid_argument);
  EXPECT_THROW((void)butterworth(4, 0.5), std::invalid_argument);
  EXPECT_THROW((void)chebyshev(4, 0.0, 0.1), std::invalid_argument);
  EXPECT_THROW((void)zero_phase(butterworth(4, 0.1), Eigen::ArrayXd::Zero(12)),
               std::invalid_argument);
}

}  // namespace
}  // namespace servotwin
