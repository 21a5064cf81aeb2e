// Regimes of motions whose velocity is piecewise linear, so that every boundary is known in closed
// form.
#include "diagnosis/statistics/residual.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace servotwin {
namespace {

constexpr double kResidualStep_s = 0.001;
constexpr double kPeakSpeed = 0.1;         // [m/s]
constexpr double kPeakAcceleration = 1.0;  // [m/s^2]

/// 1 s rest, out at 0.1 m/s with 0.1 s ramps (0.8 s at constant speed), `pause` s rest, back the
/// same way, 1 s rest.
Eigen::ArrayXd out_and_back(double pause) {
  const auto speed = [&](double t) {
    const auto trapezoid = [](double u) {
      if (u <= 0.0 || u >= 1.0) return 0.0;
      return kPeakSpeed * std::min({1.0, u / 0.1, (1.0 - u) / 0.1});
    };
    return trapezoid(t - 1.0) - trapezoid(t - 2.0 - pause);
  };
  const auto n = static_cast<Eigen::Index>(std::lround((4.0 + pause) / kResidualStep_s)) + 1;
  Eigen::ArrayXd x(n);
  double position = 0.25;
  for (Eigen::Index k = 0; k < n; ++k) {
    x(k) = position;
    const double t = static_cast<double>(k) * kResidualStep_s;
    position += kResidualStep_s * (speed(t) + speed(t + kResidualStep_s)) /
                2;  // exact: the corners fall on samples
  }
  return x;
}

const RegimeShare& of(const RegimeShares& shares, Regime regime) {
  return shares[static_cast<std::size_t>(regime)];
}

double samples_of(const RegimeShares& shares, Regime regime) {
  return static_cast<double>(of(shares, regime).samples);
}

/// The boundary of a regime is uncertain by the span of the velocity differences.
const int kBlur = static_cast<int>(std::lround(kRegimeSpan_s / kResidualStep_s)) + 1;

TEST(ByRegime, CountsTheTimeOfEveryRegimeOfATrapezoid) {
  const Eigen::ArrayXd x = out_and_back(1.0);
  const auto shares = by_regime(x, Eigen::ArrayXd::Ones(x.size()), kResidualStep_s);
  // Rests 3 x 1 s; ramps 4 x 0.1 s, of which the first 50 ms of the return belong to the reversal.
  EXPECT_NEAR(samples_of(shares, Regime::kStandstill), 3000 - 2 * (kBlur - 1), 4 * kBlur);
  EXPECT_NEAR(samples_of(shares, Regime::kConstantSpeed), 1600, 4 * kBlur);
  EXPECT_NEAR(samples_of(shares, Regime::kAcceleration), 350, 8 * kBlur);
  EXPECT_EQ(of(shares, Regime::kReversal).samples, 51);
  Eigen::Index sum = 0;
  double time = 0.0, share = 0.0;
  for (const auto& regime : shares) {
    sum += regime.samples;
    time += regime.time_share;
    share += regime.share;
    if (regime.samples == 0) continue;  // saturation is not known here
    EXPECT_DOUBLE_EQ(regime.rms, 1.0);
    EXPECT_DOUBLE_EQ(regime.max, 1.0);
    EXPECT_DOUBLE_EQ(regime.share, regime.time_share);  // the residual has the same size everywhere
  }
  EXPECT_EQ(sum, x.size() - 2 * (kBlur - 1));  // the ends have no velocity
  EXPECT_NEAR(time, 1.0, 1e-12);
  EXPECT_NEAR(share, 1.0, 1e-12);
}

TEST(ByRegime, AReversalWithoutAStopCountsOnBothSides) {
  const Eigen::ArrayXd x = out_and_back(0.0);
  const auto shares = by_regime(x, Eigen::ArrayXd::Ones(x.size()), kResidualStep_s);
  // The command stops for one instant (t = 2 s): 50 ms before the last and after the first motion.
  EXPECT_NEAR(samples_of(shares, Regime::kReversal), 101, 4);
  EXPECT_NEAR(samples_of(shares, Regime::kStandstill), 2000 - 2 * (kBlur - 1), 2 * kBlur);
}

TEST(ByRegime, GivesTheErrorToTheRegimeItHappenedIn) {
  const Eigen::ArrayXd x = out_and_back(1.0);
  Eigen::ArrayXd residual = Eigen::ArrayXd::Zero(x.size());
  residual(1500) = 3e-6;   // constant speed, out
  residual(3010) = -4e-6;  // 10 ms after the start of the return
  const auto shares = by_regime(x, residual, kResidualStep_s);
  EXPECT_DOUBLE_EQ(of(shares, Regime::kConstantSpeed).share, 9.0 / 25.0);
  EXPECT_DOUBLE_EQ(of(shares, Regime::kReversal).share, 16.0 / 25.0);
  EXPECT_DOUBLE_EQ(of(shares, Regime::kReversal).max, 4e-6);
  EXPECT_DOUBLE_EQ(of(shares, Regime::kReversal).rms, 4e-6 / std::sqrt(51.0));
  EXPECT_EQ(of(shares, Regime::kStandstill).share, 0.0);
  EXPECT_EQ(of(shares, Regime::kAcceleration).max, 0.0);
}

TEST(ByRegime, ASineOnlyAcceleratesAndTurns) {
  // v = V cos(w t): |a| <= 5 % of its peak only within asin(0.05) of a speed maximum.
  const double omega = 2 * std::numbers::pi;
  Eigen::ArrayXd x(10001);
  for (Eigen::Index k = 0; k < x.size(); ++k) {
    x(k) = 0.01 * std::sin(omega * static_cast<double>(k) * kResidualStep_s);
  }
  const auto shares = by_regime(x, Eigen::ArrayXd::Ones(x.size()), kResidualStep_s);
  EXPECT_EQ(of(shares, Regime::kStandstill).samples, 0);
  const double turns = 20, per_turn_s = 2 * (kReversalWindow_s + std::asin(0.005) / omega);
  EXPECT_NEAR(samples_of(shares, Regime::kReversal), turns * per_turn_s / kResidualStep_s,
              2 * turns);
  const double constant_s = 20 * 2 * std::asin(0.05) / omega;
  EXPECT_NEAR(samples_of(shares, Regime::kConstantSpeed), constant_s / kResidualStep_s, 60);
}

TEST(ByRegime, AQuantisedCommandIsNotAcceleration) {
  Eigen::ArrayXd x = out_and_back(1.0);
  const auto exact = by_regime(x, Eigen::ArrayXd::Ones(x.size()), kResidualStep_s);
  x = (x / 1e-6).round() * 1e-6;
  const auto quantised = by_regime(x, Eigen::ArrayXd::Ones(x.size()), kResidualStep_s);
  for (std::size_t i = 0; i < kRegimes; ++i) {
    const Regime regime = exact[i].regime;
    EXPECT_NEAR(samples_of(quantised, regime), samples_of(exact, regime), kBlur) << name_of(regime);
  }
}

TEST(ByRegime, RoundingIsNotAcceleration) {
  // Constant speed throughout: the differences give an acceleration of about 1e-13 m/s^2.
  Eigen::ArrayXd x(2000);
  for (Eigen::Index k = 0; k < x.size(); ++k) x(k) = 0.1 * static_cast<double>(k) * kResidualStep_s;
  const auto shares = by_regime(x, Eigen::ArrayXd::Ones(x.size()), kResidualStep_s);
  EXPECT_EQ(samples_of(shares, Regime::kConstantSpeed), 2000 - 2 * (kBlur - 1));
}

TEST(ByRegime, HolesAreLeftOut) {
  const Eigen::ArrayXd x = out_and_back(1.0);
  Eigen::ArrayXd residual = Eigen::ArrayXd::Ones(x.size());
  residual.segment(1500, 10) = std::numeric_limits<double>::quiet_NaN();
  const auto whole = by_regime(x, Eigen::ArrayXd::Ones(x.size()), kResidualStep_s);
  const auto holed = by_regime(x, residual, kResidualStep_s);
  EXPECT_EQ(of(holed, Regime::kConstantSpeed).samples,
            of(whole, Regime::kConstantSpeed).samples - 10);
  EXPECT_DOUBLE_EQ(of(holed, Regime::kConstantSpeed).rms, 1.0);
}

TEST(ByRegime, StretchesShareTheirPeaks) {
  // Alone, the slow stretch counts as motion; together with the fast one it counts as standstill.
  ResidualStretch fast{out_and_back(1.0), {}, kResidualStep_s};
  fast.residual = Eigen::ArrayXd::Zero(fast.command.size());
  ResidualStretch slow{fast.command * 1e-3, Eigen::ArrayXd::Ones(fast.command.size()),
                       kResidualStep_s};
  const std::vector<ResidualStretch> both{fast, slow};
  EXPECT_DOUBLE_EQ(of(by_regime(both), Regime::kStandstill).share, 1.0);
  EXPECT_LT(of(by_regime(slow.command, slow.residual, kResidualStep_s), Regime::kStandstill).share,
            0.7);
}

TEST(ByRegime, NothingIsNoResidual) {
  const auto shares = by_regime(Eigen::ArrayXd(), Eigen::ArrayXd(), kResidualStep_s);
  for (const auto& regime : shares) EXPECT_EQ(regime.samples, 0);
}

TEST(ByRegime, RefusesWhatDoesNotFit) {
  EXPECT_THROW((void)by_regime(Eigen::ArrayXd::Zero(3), Eigen::ArrayXd::Zero(2), kResidualStep_s),
               std::invalid_argument);
  EXPECT_THROW((void)by_regime(Eigen::ArrayXd::Zero(3), Eigen::ArrayXd::Zero(3), 0.0),
               std::invalid_argument);
}

TEST(AtLimit, IsWhereATorqueIsCutOffAndNotWhereItOnlyPeaks) {
  const Eigen::Index n = 4000;
  Eigen::ArrayXd sine(n);
  for (Eigen::Index k = 0; k < n; ++k)
    sine(k) =
        10.0 * std::sin(2.0 * std::numbers::pi * 0.5 * kResidualStep_s * static_cast<double>(k));
  EXPECT_EQ(at_limit(sine, kResidualStep_s).size(), 0);
  EXPECT_EQ(at_limit(sine.round(), kResidualStep_s).size(), 0)
      << "a coarsely rounded torque stays at its peak";
  EXPECT_EQ(at_limit({}, kResidualStep_s).size(), 0);
  EXPECT_EQ(at_limit(Eigen::ArrayXd::Zero(n), kResidualStep_s).size(), 0)
      << "a drive that sends no torque";
  EXPECT_EQ(at_limit(Eigen::ArrayXd::Constant(n, 3.0), kResidualStep_s).size(), 0);
  EXPECT_EQ(at_limit(sine.max(0.0), kResidualStep_s).size(), 0) << "a load meter rests at 0";
  // Clipped above only: where the sine exceeds 8.
  const Eigen::ArrayXd limit = at_limit(sine.min(8.0), kResidualStep_s);
  ASSERT_EQ(limit.size(), n);
  EXPECT_EQ((limit > 0.0).count(), (sine >= 8.0).count());
  EXPECT_TRUE(((limit > 0.0) == (sine >= 8.0)).all());
}

TEST(ByRegime, SaturationComesBeforeAllOthers) {
  const Eigen::ArrayXd x = out_and_back(1.0);
  ResidualStretch stretch{x, Eigen::ArrayXd::Ones(x.size()), kResidualStep_s, 0.0};
  stretch.saturated = Eigen::ArrayXd::Zero(x.size());
  stretch.saturated.segment(900, 300).setOnes();  // rest, ramp and constant speed
  const auto with = by_regime(std::span(&stretch, 1));
  EXPECT_EQ(of(with, Regime::kSaturation).samples, 300);
  const auto without = by_regime(x, Eigen::ArrayXd::Ones(x.size()), kResidualStep_s);
  EXPECT_EQ(of(without, Regime::kSaturation).samples, 0);
  EXPECT_NEAR(samples_of(without, Regime::kStandstill) - samples_of(with, Regime::kStandstill), 100,
              kBlur);
}

}  // namespace
}  // namespace servotwin
