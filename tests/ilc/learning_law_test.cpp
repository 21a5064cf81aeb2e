#include "ilc/learning_law.h"

#include <gmock/gmock.h>

#include <Eigen/Dense>
#include <cmath>

#include "ilc/feedforward.h"
#include "ilc/uncertainty.h"
#include "tests/ilc/study.h"
#include "twin/twin.h"

namespace servotwin {
namespace {

using study::kStep_s;
using testing::HasSubstr;

LearningLaw law_of(Law kind, double bandwidth_hz) {
  LearningLaw law;
  law.law = kind;
  law.model = transfer_of(study::mismatched());
  law.bandwidth_hz = bandwidth_hz;
  law.derivative_s = law.model.lag_s();
  return law;
}

std::vector<Transfer> truth() { return {transfer_of(study::plant())}; }

// The reference experiment's max |Q (1 - L T)| of the model that is off.
TEST(LearningLaw, ContractsAsTheReferenceSays) {
  const std::vector<std::pair<double, double>> expected{
      {20.0, 0.0241268}, {50.0, 0.0844862}, {100.0, 0.0992268}, {200.0, 0.100596}};
  for (const auto& [bandwidth_hz, most] : expected)
    EXPECT_NEAR(contraction(law_of(Law::kInverse, bandwidth_hz), truth(), kStep_s).most(), most,
                0.003 * most)
        << bandwidth_hz;
  const ContractionCurve own = contraction(law_of(Law::kInverse, 100.0), truth(), kStep_s);
  EXPECT_LT(own.of_model.maxCoeff(), 1e-12) << "an inverse of itself";
}

TEST(LearningLaw, TheBandwidthIsTheLargestThatContracts) {
  for (const Law kind : {Law::kInverse, Law::kNormOptimal, Law::kP, Law::kPd}) {
    LearningLaw law = law_of(kind, 0.0);
    const std::vector<Transfer> models =
        models_within(law.model, relative_uncertainty(law.model, 0.15));
    law.bandwidth_hz = robust_bandwidth(law, models, kStep_s);
    ASSERT_GT(law.bandwidth_hz, 1.0);
    EXPECT_LE(contraction(law, models, kStep_s).most(), kContraction * (1.0 + 1e-9));
    law.bandwidth_hz *= 1.01;
    EXPECT_GT(contraction(law, models, kStep_s).most(), kContraction);
  }
}

TEST(LearningLaw, MoreUncertaintyMeansLessBandwidth) {
  LearningLaw law = law_of(Law::kInverse, 0.0);
  double before = 1e300;
  for (const double share : {0.05, 0.1, 0.15, 0.2}) {
    TransferUncertainty uncertainty = relative_uncertainty(law.model, share);
    uncertainty.timing_s = 1e-3;
    const double bandwidth = robust_bandwidth(law, models_within(law.model, uncertainty), kStep_s);
    EXPECT_LT(bandwidth, before) << share;
    before = bandwidth;
  }
}

// A delay of one period, and nothing else: |1 - exp(-i w t)| = 2 sin(w t / 2).
TEST(LearningLaw, AnUnknownDelayBoundsTheBandwidthByItsClosedForm) {
  LearningLaw law = law_of(Law::kInverse, 80.0);
  TransferUncertainty uncertainty;
  uncertainty.timing_s = 1e-3;
  const ContractionCurve curve = contraction(law, models_within(law.model, uncertainty), kStep_s);
  for (Eigen::Index k = 0; k < curve.worst.size(); ++k) {
    const double omega = 2.0 * std::numbers::pi * curve.frequency_hz(k);
    if (omega * 1e-3 > std::numbers::pi) break;
    EXPECT_NEAR(curve.worst(k), law.q(omega) * 2.0 * std::sin(0.5e-3 * omega), 1e-12);
  }
}

TEST(LearningLaw, WhatMayDivergeIsRefusedWithTheBandwidthThatWouldDo) {
  const LearningLaw without = law_of(Law::kP, std::numeric_limits<double>::infinity());
  const std::string why = why_refused(without, truth(), kStep_s);
  EXPECT_THAT(why, HasSubstr("|Q (1 - L T)| reaches"));
  EXPECT_THAT(why, HasSubstr("take a bandwidth of at most"));
  EXPECT_EQ(why_refused(law_of(Law::kP, 5.0), truth(), kStep_s), "");
  EXPECT_EQ(why_refused(law_of(Law::kInverse, 100.0), truth(), kStep_s), "");
}

// Every model within the uncertainty, at frequencies that the search has not looked at.
TEST(LearningLaw, TheHarmlessBandwidthIsTheLargestThatHarmsNoModelAtAnyFrequency) {
  LearningLaw law = law_of(Law::kInverse, 0.0);
  TransferUncertainty uncertainty = relative_uncertainty(law.model, 0.1);
  uncertainty.timing_s = 1e-3;
  const std::vector<Transfer> models = models_within(law.model, uncertainty);
  law.bandwidth_hz = harmless_bandwidth(law, models, kStep_s);
  EXPECT_GT(law.bandwidth_hz, robust_bandwidth(law, models, kStep_s));
  const auto worst = [&] {
    double out = 0.0;
    for (double f = 0.13; f < 0.5 / kStep_s; f *= 1.004) {
      const double omega = 2.0 * std::numbers::pi * f;
      for (const Transfer& t : models)
        out = std::max(out, std::abs(1.0 - law.q(omega) * law.l(omega) * t.at(omega)));
    }
    return out;
  };
  constexpr double kBetweenFrequencies = 1e-4;
  EXPECT_LT(worst(), kMaxErrorRatioAtAnyFrequency + kBetweenFrequencies);
  EXPECT_NEAR(left_by_feedforward(law, models, kStep_s).most(), worst(), 1e-3);
  law.bandwidth_hz *= 1.02;
  EXPECT_GT(worst(), kMaxErrorRatioAtAnyFrequency + kBetweenFrequencies);
}

TEST(Uncertainty, KeepsWhatIsCertain) {
  const Transfer model = transfer_of(study::plant());
  TransferUncertainty uncertainty = relative_uncertainty(model, 0.2);
  uncertainty.covariance.row(2).setZero();
  uncertainty.covariance.col(2).setZero();
  const auto first = models_within(model, uncertainty), again = models_within(model, uncertainty);
  ASSERT_EQ(first.size(), again.size());
  const PoleSet named = labels_of(model.loop).set[0];
  for (std::size_t i = 0; i < first.size(); ++i) {
    EXPECT_EQ(first[i].at(100.0), again[i].at(100.0));
    EXPECT_NEAR(std::abs(first[i].at(1e-6) - 1.0), 0.0, 1e-6) << "it comes to where it is told to";
    EXPECT_TRUE(stable(first[i].loop));
    const PoleLabels labels = labels_of(first[i].loop);
    if (labels.count > 1) continue;
    EXPECT_NEAR(labels.set[0].zeta, named.zeta, 1e-9 * named.zeta);
    EXPECT_LE(std::abs(labels.set[0].omega - named.omega), 0.4 * named.omega * (1.0 + 1e-9));
  }
}

// (theta - theta_0)^T C^(-1) (theta - theta_0) = deviations^2 of every model but the one in the
// middle, with values that hang together by more than 0.9.
TEST(Uncertainty, TheModelsAreThoseOfTheEllipsoid) {
  const Transfer model = transfer_of(study::plant());
  using Values = Eigen::Matrix<double, kLoopValues, 1>;
  const auto values_of = [](const Transfer& t) {
    const PoleSet poles = labels_of(t.loop).set[0];
    Values out;
    out << poles.real, poles.omega, poles.zeta, t.loop.numerator[0], t.loop.numerator[1],
        t.loop.numerator[2], t.delay_s;
    return out;
  };
  const Values middle = values_of(model);
  Values deviation = 0.004 * middle;
  deviation(kLoopValues - 1) = 1e-4;
  LoopCovariance correlation = LoopCovariance::Constant(0.95);
  correlation.diagonal().setOnes();
  correlation.row(2) *= -1.0;
  correlation.col(2) *= -1.0;
  TransferUncertainty uncertainty;
  uncertainty.covariance = deviation.asDiagonal() * correlation * deviation.asDiagonal();
  const LoopCovariance inverse = uncertainty.covariance.inverse();
  const std::vector<Transfer> models = models_within(model, uncertainty);
  int moved = 0;
  for (const Transfer& one : models) {
    ASSERT_EQ(labels_of(one.loop).count, 1);
    const Values by = values_of(one) - middle;
    const double square = by.dot(inverse * by);
    if (by.norm() < 1e-12) continue;
    EXPECT_NEAR(square, 4.0, 1e-6);
    ++moved;
  }
  EXPECT_GT(moved, 200);
}

// T against the twin itself: a sine through it, linear parts of effects with it.
TEST(Transfer, IsWhatTheTwinDoes) {
  Model model = study::plant();
  model.effects[0].coefficient[0] = 0.0;
  model.effects[0].coefficient[1] = 20.0;  // viscous
  Effect mismatch = make_effect<FeedforwardMismatch>(), mode = make_effect<Compliance>(),
         delay = make_effect<TimeDelay>();
  mismatch.coefficient = {30.0, 0.2};
  mode.shape = {45.0, 0.05, 1e-3};
  mode.coefficient = {40.0, 3.0};
  delay.shape[0] = 1.7e-3;
  for (const int order : {3, 2}) {
    if (order == 2) {
      model.loop.order = 2;
      model.loop.denominator = {92.1, 14412.0, 0.0};
      model.loop.numerator = {1.0, 92.1, 0.0};
      mismatch.coefficient = {8.0, 0.1};
    }
    model.effects.resize(1);
    model.effects.insert(model.effects.end(), {mismatch, mode, delay});
    const Transfer transfer = transfer_of(model);
    for (const double f : {2.0, 11.0, 30.0, 60.0}) {
      const double omega = 2.0 * std::numbers::pi * f;
      Segment segment;
      segment.sample_time_s = 1e-4;
      model.sample_time_s = 1e-4;
      const Eigen::Index n = 60'000;
      segment.command =
          1e-4 *
          (Eigen::ArrayXd::LinSpaced(n, 0.0, static_cast<double>(n - 1)) * 1e-4 * omega).sin();
      const Eigen::ArrayXd x = segment.command - simulate(model, segment);
      // Of the last second, which holds whole periods.
      std::complex<double> in = 0.0, out = 0.0;
      for (Eigen::Index k = n - 10'000; k < n; ++k) {
        const std::complex<double> turn = std::polar(1.0, -omega * 1e-4 * static_cast<double>(k));
        in += segment.command(k) * turn;
        out += x(k) * turn;
      }
      // The twin holds the mode's acceleration over a cycle, which turns its part by w h / 2.
      EXPECT_LT(std::abs(out / in - transfer.at(omega)), 5e-3) << order << ", " << f;
    }
  }
}

// A filter of the control follows the mean over a cycle: the same at any sampling time.
TEST(Transfer, OfAFilterOfTheControlIsWhatTheTwinDoes) {
  Model model = study::plant();
  model.effects.clear();
  Effect filter = make_effect<ControlFilter>();
  filter.coefficient = {-90.0, -45.0};
  for (const double damping : {0.3, 1.0, 2.0}) {
    filter.shape = {12.0, damping};
    model.effects = {filter};
    const Transfer transfer = transfer_of(model);
    for (const double h : {1e-3, 4e-3}) {
      model.sample_time_s = h;
      for (const double f : {2.0, 5.0, 10.0}) {
        const double omega = 2.0 * std::numbers::pi * f;
        Segment segment;
        segment.sample_time_s = h;
        const auto n = static_cast<Eigen::Index>(std::lround(6.0 / h));
        const Eigen::ArrayXd t = h * Eigen::ArrayXd::LinSpaced(n, 0.0, static_cast<double>(n - 1));
        segment.command = 1e-4 * (omega * t).sin();
        const Eigen::ArrayXd x = segment.command - simulate(model, segment);
        std::complex<double> in = 0.0, out = 0.0;
        for (Eigen::Index k = n - static_cast<Eigen::Index>(std::lround(1.0 / h)); k < n; ++k) {
          const std::complex<double> turn = std::polar(1.0, -omega * t(k));
          in += segment.command(k) * turn;
          out += x(k) * turn;
        }
        EXPECT_LT(std::abs(out / in - transfer.at(omega)), 2e-3)
            << damping << ", " << h << ", " << f;
      }
    }
  }
}

// The impulse response and the frequency response are of one T. The impulse is a triangle two
// samples wide, whose spectrum is the square of sin(w h / 2) / (w h / 2).
TEST(Transfer, TheImpulseResponseHasTheFilterOfTheControl) {
  for (const int order : {2, 3}) {
    Model model = study::plant();
    if (order == 2) {
      model.loop.order = 2;
      model.loop.denominator = {92.1, 14412.0, 0.0};
      model.loop.numerator = {1.0, 92.1, 0.0};
    }
    Effect filter = make_effect<ControlFilter>(), table = make_effect<Compliance>();
    filter.shape = {12.0, 1.0};
    filter.coefficient = {-90.0, -45.0};
    table.shape = {45.0, 0.05};
    table.coefficient = {40.0, 3.0};
    model.effects = {filter, table};
    const Transfer transfer = transfer_of(model);
    const Eigen::ArrayXd impulse = impulse_response(transfer, kStep_s, 4000);
    for (const double f : {1.0, 5.0, 10.0, 20.0, 45.0}) {
      const double omega = 2.0 * std::numbers::pi * f, half = 0.5 * omega * kStep_s;
      std::complex<double> sum = 0.0;
      for (Eigen::Index k = 0; k < impulse.size(); ++k)
        sum += impulse(k) * std::polar(1.0, -omega * kStep_s * static_cast<double>(k));
      const double triangle = std::pow(std::sin(half) / half, 2);
      EXPECT_LT(std::abs(sum - triangle * transfer.at(omega)), 2e-4) << order << ", " << f;
    }
  }
}

// At a reversal a filter of the control adds to friction what its two poles (both at w, damping 1)
// still hold: ringing 2 (1 + w t) exp(-w t).
TEST(CommandedEffects, HaveWhatAFilterOfTheControlAddsToFriction) {
  constexpr double kCoulomb = 0.3, kRinging = 0.5, kHz = 12.0, kSpeed = 0.05;
  Model model = study::plant();
  Effect friction = make_effect<CoulombFriction>(), filter = make_effect<ControlFilter>();
  friction.coefficient[0] = kCoulomb;
  filter.shape = {kHz, 1.0};
  filter.coefficient = {-90.0, -45.0, kRinging, 0.0};
  model.effects = {friction, filter};
  model.sample_time_s = 1e-3;
  Segment segment;
  segment.sample_time_s = 1e-3;
  const Eigen::Index turn = 1000;
  segment.command.resize(2 * turn);
  for (Eigen::Index k = 0; k < segment.size(); ++k)
    segment.command(k) = kSpeed * 1e-3 * static_cast<double>(std::min(k, 2 * turn - k));
  const Eigen::ArrayXd force = commanded_effects(model, segment).force;
  const double w = 2.0 * std::numbers::pi * kHz;
  for (const Eigen::Index after : {10, 20, 40, 80}) {
    const double t = 1e-3 * static_cast<double>(after);
    EXPECT_NEAR(force(turn + after), -kCoulomb - kRinging * 2.0 * (1.0 + w * t) * std::exp(-w * t),
                0.02)
        << after;
  }
}

// The first column of the lifted T, of the reference.
TEST(Transfer, TheImpulseResponseIsTheReferences) {
  const Eigen::ArrayXd impulse = impulse_response(transfer_of(study::plant()), kStep_s, 10);
  const std::vector<double> expected{
      0.001030406639124987, 0.006048969709007665, 0.011709093577468485, 0.016906861126826864,
      0.021610022303003417, 0.02579638112879769,  0.02945308494129323,  0.032575860699400105,
      0.035168213661680575, 0.03724060272308956};
  for (Eigen::Index k = 0; k < impulse.size(); ++k)
    EXPECT_NEAR(impulse(k), expected[static_cast<std::size_t>(k)], 1e-12) << k;
}

}  // namespace
}  // namespace servotwin
