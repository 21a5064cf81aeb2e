// Poles from responses whose closed form is known, and how they scatter with noise.
#include "identification/response/vector_fitting.h"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <span>

namespace servotwin {
namespace {

using Complex = std::complex<double>;

constexpr double kHz = 2.0 * std::numbers::pi;

/// gain (omega^2 + slope omega s) / (s^2 + 2 zeta omega s + omega^2)
struct Resonance {
  double hz, zeta, gain, slope;
};

const std::vector<Resonance> kModes{{45.0, 0.03, 1.0, 0.1},   {72.0, 0.02, -0.5, 0.3},
                                    {110.0, 0.015, 0.7, 0.0}, {160.0, 0.03, -0.6, 0.2},
                                    {210.0, 0.01, 0.3, -0.2}, {280.0, 0.05, 0.8, 0.4}};

Complex response(std::span<const Resonance> modes, double direct, double omega) {
  const Complex s(0.0, omega);
  Complex out = direct;
  for (const Resonance& m : modes) {
    const double w = kHz * m.hz;
    out += m.gain * (w * w + m.slope * w * s) / (s * s + 2.0 * m.zeta * w * s + w * w);
  }
  return out;
}

ResponsePoints points_of(std::span<const Resonance> modes, double deviation, int count = 400) {
  ResponsePoints out;
  out.omega = kHz * Eigen::ArrayXd::LinSpaced(count, 2.0, 350.0);
  out.response.resize(count, 1);
  for (Eigen::Index i = 0; i < count; ++i) out.response(i, 0) = response(modes, 0.1, out.omega(i));
  out.deviation = Eigen::MatrixXd::Constant(count, 1, deviation);
  return out;
}

void add_noise(ResponsePoints& points, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  for (Eigen::Index i = 0; i < points.response.size(); ++i) {
    const double re = normal(random), im = normal(random);
    points.response(i) += points.deviation(i) * Complex(re, im);
  }
}

const FittedPole& nearest(const RationalFit& fit, double hz) {
  return *std::min_element(fit.poles.begin(), fit.poles.end(), [&](const auto& l, const auto& r) {
    return std::abs(l.omega - kHz * hz) < std::abs(r.omega - kHz * hz);
  });
}

class VectorFitting : public testing::TestWithParam<std::size_t> {};

TEST_P(VectorFitting, RecoversTheModesOfAClosedForm) {
  const std::span modes(kModes.data(), GetParam());
  const auto fit = fit_rational(points_of(modes, 1e-6), 2 * static_cast<int>(modes.size()));
  ASSERT_TRUE(fit);
  EXPECT_EQ(fit->poles.size(), modes.size());
  for (const Resonance& mode : modes) {
    const FittedPole& pole = nearest(*fit, mode.hz);
    EXPECT_TRUE(pole.pair);
    EXPECT_NEAR(pole.omega, kHz * mode.hz, 1e-8 * kHz * mode.hz);
    EXPECT_NEAR(pole.zeta, mode.zeta, 1e-8);
  }
  // Between the points, too.
  for (const double hz : {3.3, 45.1, 133.3, 209.9, 349.0})
    EXPECT_LT(std::abs(fit->at(0, kHz * hz) - response(modes, 0.1, kHz * hz)), 1e-8);
  for (std::size_t i = 1; i < fit->poles.size(); ++i)
    EXPECT_GE(fit->poles[i - 1].explains, fit->poles[i].explains);
}

TEST_P(VectorFitting, FindsTheNumberOfModesOnPointsThatItHasNotSeen) {
  const std::span modes(kModes.data(), GetParam());
  std::mt19937_64 random(7);
  std::array<ResponsePoints, 2> halves{points_of(modes, 0.01), points_of(modes, 0.01)};
  for (ResponsePoints& half : halves) add_noise(half, random);
  ResponsePoints all = halves[0];
  all.response = 0.5 * (halves[0].response + halves[1].response);
  all.deviation /= std::numbers::sqrt2;
  const auto chosen = fit_rational_order(all, halves, 16);
  ASSERT_TRUE(chosen);
  EXPECT_EQ(chosen->fit.order(), 2 * static_cast<int>(modes.size()));
  EXPECT_NEAR(chosen->fit.misfit, 1.0, 0.2);
  for (const Resonance& mode : modes) {
    const FittedPole& pole = nearest(chosen->fit, mode.hz);
    EXPECT_NEAR(pole.omega, kHz * mode.hz, 4.0 * pole.omega_deviation);
    EXPECT_NEAR(pole.zeta, mode.zeta, 4.0 * pole.zeta_deviation);
    EXPECT_LT(pole.omega_deviation, 0.001 * pole.omega);
  }
}

INSTANTIATE_TEST_SUITE_P(Modes, VectorFitting, testing::Values(1, 2, 4, 6));

class VectorFittingScatter : public testing::TestWithParam<Resonance> {};

TEST_P(VectorFittingScatter, IsThatOfTheCramerRaoBound) {
  // Fisher's matrix over (omega, zeta, gain, slope, direct), from the closed form alone.
  const std::vector<Resonance> truth{GetParam()};
  constexpr double kNoise = 0.05;
  const ResponsePoints clean = points_of(truth, kNoise);
  const auto shifted = [&](int parameter, double by) {
    Resonance m = truth[0];
    double direct = 0.1;
    double* const all[] = {&m.hz, &m.zeta, &m.gain, &m.slope, &direct};
    *all[parameter] += by;
    Eigen::VectorXcd out(clean.omega.size());
    for (Eigen::Index i = 0; i < out.size(); ++i)
      out(i) = response({&m, 1}, direct, clean.omega(i));
    return out;
  };
  Eigen::MatrixXd slopes(2 * clean.omega.size(), 5);
  for (int k = 0; k < 5; ++k) {
    const double step = k == 0 ? 1e-4 : 1e-6;
    const Eigen::VectorXcd d = (shifted(k, step) - shifted(k, -step)) / (2.0 * step * kNoise);
    slopes.col(k) << d.real(), d.imag();
  }
  const Eigen::MatrixXd bound = (slopes.transpose() * slopes).inverse();

  constexpr int kTrials = 400;
  std::mt19937_64 random(11);
  Eigen::ArrayXd hz(kTrials), zeta(kTrials), hz_said(kTrials), zeta_said(kTrials);
  for (int i = 0; i < kTrials; ++i) {
    ResponsePoints noisy = clean;
    add_noise(noisy, random);
    const auto fit = fit_rational(noisy, 2);
    ASSERT_TRUE(fit);
    hz(i) = fit->poles[0].omega / kHz;
    zeta(i) = fit->poles[0].zeta;
    hz_said(i) = fit->poles[0].omega_deviation / kHz;
    zeta_said(i) = fit->poles[0].zeta_deviation;
  }
  // The scatter of a deviation from n trials is 1/sqrt(2 n): 3.5 %; four of them.
  const auto deviation = [](const Eigen::ArrayXd& x) {
    return std::sqrt((x - x.mean()).square().sum() / (kTrials - 1));
  };
  EXPECT_NEAR(deviation(hz) / std::sqrt(bound(0, 0)), 1.0, 0.14);
  EXPECT_NEAR(deviation(zeta) / std::sqrt(bound(1, 1)), 1.0, 0.14);
  EXPECT_NEAR(hz.mean(), truth[0].hz, 4.0 * std::sqrt(bound(0, 0) / kTrials));
  EXPECT_NEAR(zeta.mean(), truth[0].zeta, 4.0 * std::sqrt(bound(1, 1) / kTrials));
  // The stated deviation is the bound times the misfit of this noise.
  EXPECT_NEAR(hz_said.mean() / std::sqrt(bound(0, 0)), 1.0, 0.05);
  EXPECT_NEAR(zeta_said.mean() / std::sqrt(bound(1, 1)), 1.0, 0.05);
}

// Lightly damped, and as a position loop is, where omega and zeta are correlated.
INSTANTIATE_TEST_SUITE_P(Modes, VectorFittingScatter,
                         testing::Values(kModes[0], Resonance{60.0, 0.6, 1.0, 0.3}));

TEST(VectorFittingPoles, AreCommonToAllChannels) {
  // The second channel hardly contains the first mode, and vice versa.
  ResponsePoints points = points_of(std::span(kModes.data(), 2), 1e-3);
  points.response.conservativeResize(Eigen::NoChange, 2);
  points.deviation = Eigen::MatrixXd::Constant(points.omega.size(), 2, 1e-3);
  std::vector<Resonance> first{kModes[0], kModes[1]}, second = first;
  first[1].gain = second[0].gain = 1e-3;
  for (Eigen::Index i = 0; i < points.omega.size(); ++i) {
    points.response(i, 0) = response(first, 0.1, points.omega(i));
    points.response(i, 1) = response(second, 0.1, points.omega(i));
  }
  const auto fit = fit_rational(points, 4);
  ASSERT_TRUE(fit);
  for (const Resonance& mode : first) {
    EXPECT_NEAR(nearest(*fit, mode.hz).omega, kHz * mode.hz, 1e-6 * kHz * mode.hz);
    EXPECT_NEAR(nearest(*fit, mode.hz).zeta, mode.zeta, 1e-6);
  }
  EXPECT_LT(std::abs(fit->at(1, kHz * 70.0) - response(second, 0.1, kHz * 70.0)), 1e-6);
}

TEST(VectorFittingPoles, RealOnesAndADelayAreFoundToo) {
  const double fast = kHz * 90.0, slow = kHz * 8.0, tau = 0.004;
  ResponsePoints points = points_of(std::span(kModes.data(), 1), 1e-6);
  for (Eigen::Index i = 0; i < points.omega.size(); ++i) {
    const Complex s(0.0, points.omega(i));
    points.response(i, 0) += slow / (s + slow) - 2.0 * fast / (s + fast);
    points.response(i, 0) *= std::polar(1.0, -tau * points.omega(i));
  }
  const auto fit = fit_rational(points, 4, {.delay_s = tau});
  ASSERT_TRUE(fit);
  std::vector<double> real;
  for (const FittedPole& pole : fit->poles) {
    if (!pole.pair) {
      real.push_back(pole.omega);
    } else if (pole.zeta >= 1.0) {
      const double root = std::sqrt(pole.zeta * pole.zeta - 1.0);
      real.push_back(pole.omega * (pole.zeta - root));
      real.push_back(pole.omega * (pole.zeta + root));
    } else {
      EXPECT_NEAR(pole.omega, kHz * 45.0, 1e-6 * kHz * 45.0);
    }
  }
  std::sort(real.begin(), real.end());
  ASSERT_EQ(real.size(), 2u);
  EXPECT_NEAR(real[0], slow, 1e-6 * slow);
  EXPECT_NEAR(real[1], fast, 1e-6 * fast);
  EXPECT_LT(std::abs(fit->at(0, points.omega(100)) - points.response(100, 0)), 1e-6);
}

TEST(VectorFittingPoles, AreStableWhateverTheDataSay) {
  // An unstable pair: its fit is poor, but no pole is on the right.
  ResponsePoints points = points_of(std::span(kModes.data(), 1), 0.01);
  points.response = points.response.conjugate().eval();
  for (const int order : {1, 2, 3, 4}) {
    const auto fit = fit_rational(points, order);
    ASSERT_TRUE(fit);
    for (const FittedPole& pole : fit->poles) {
      EXPECT_GT(pole.omega, 0.0);
      EXPECT_GT(pole.zeta, 0.0);
    }
    EXPECT_GT(fit->misfit, 100.0);
  }
}

TEST(VectorFittingPoles, NeedMorePointsThanParameters) {
  EXPECT_FALSE(fit_rational(points_of(std::span(kModes.data(), 1), 1.0, 2), 2));
  EXPECT_TRUE(fit_rational(points_of(std::span(kModes.data(), 1), 1.0, 3), 2));
  EXPECT_FALSE(fit_rational(points_of(std::span(kModes.data(), 1), 1.0), 0));
  EXPECT_FALSE(fit_rational(points_of(std::span(kModes.data(), 1), 1.0), kMaxPoles + 1));
}

}  // namespace
}  // namespace servotwin
