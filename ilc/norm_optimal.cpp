#include "ilc/norm_optimal.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

namespace servotwin {
namespace {

using Signal = Eigen::ArrayXd;

constexpr double kResidual = 1e-10;  // of the conjugate gradients, relative to the right-hand side
constexpr int kMaxSteps = 300;
constexpr double kRoundResidual = 1e-6;  // likewise, within the splitting
constexpr double kPenaltyShare = 0.05;   // penalty of the splitting over the largest eigenvalue
constexpr int kMaxRounds = 100;          // of the splitting
// Violation of a limit, as a share of it, at which the splitting ends.
constexpr double kLimitTolerance = 3e-4;

double dot(const Signal& a, const Signal& b) { return a.matrix().dot(b.matrix()); }

/// The steps of a signal, and the transposed of that.
Signal steps(const Signal& x) {
  Signal out = x;
  out.tail(x.size() - 1) -= x.head(x.size() - 1);
  return out;
}
Signal steps_transposed(const Signal& x) {
  Signal out = x;
  out.head(x.size() - 1) -= x.tail(x.size() - 1);
  return out;
}

}  // namespace

NormOptimal::NormOptimal(const LearningLaw& law, const CorrectionLimits& limits,
                         Eigen::Index samples, double h)
    : samples_(samples),
      padded_(4),
      rho_(law.weight),
      h_(h),
      stretch_(1.0 / (2.0 * std::numbers::pi * h * std::min(law.bandwidth_hz, 0.1 / h))),
      limits_(limits) {
  assert(law.law == Law::kNormOptimal && samples > 1);
  while (padded_ < 2 * samples) padded_ *= 2;
  fft_.SetFlag(Eigen::FFT<double>::HalfSpectrum);
  time_.assign(static_cast<std::size_t>(padded_), 0.0);
  const Eigen::ArrayXd impulse = impulse_response(law.model, h, samples);
  std::copy(impulse.begin(), impulse.end(), time_.begin());
  fft_.fwd(spectrum_, time_);
  const Eigen::Index bins = padded_ / 2 + 1;
  t_ = Eigen::Map<const Eigen::ArrayXcd>(spectrum_.data(), bins);
  const Eigen::ArrayXd omega = Eigen::ArrayXd::LinSpaced(bins, 0.0, std::numbers::pi / h);
  const Eigen::ArrayXd square = t_.abs2();
  const Eigen::ArrayXd beyond =
      std::isfinite(law.bandwidth_hz)
          ? Eigen::ArrayXd((omega / (2.0 * std::numbers::pi * law.bandwidth_hz)).pow(4.0))
          : Eigen::ArrayXd::Zero(bins);
  weight_ = (square * beyond).cast<std::complex<double>>();
  symbol_ = square * (1.0 + beyond) + rho_;
  slope_ = 4.0 * (0.5 * omega * h).sin().square();
}

Signal NormOptimal::convolved(const Signal& x, const Eigen::ArrayXcd& symbol) {
  std::copy(x.begin(), x.end(), time_.begin());
  std::fill(time_.begin() + samples_, time_.end(), 0.0);
  fft_.fwd(spectrum_, time_);
  for (Eigen::Index k = 0; k < symbol.size(); ++k)
    spectrum_[static_cast<std::size_t>(k)] *= symbol(k);
  fft_.inv(time_, spectrum_, padded_);
  return Eigen::Map<const Signal>(time_.data(), samples_);
}

Signal NormOptimal::hessian(const Signal& x, double pull) {
  Signal out = times_t_transposed(times_t(x)) + rho_ * x + weighted(x);
  if (pull > 0.0) out += pull * (x + stretch_ * stretch_ * steps_transposed(steps(x)));
  out(0) = out(samples_ - 1) = 0.0;
  return out;
}

Signal NormOptimal::solved(const Signal& right, const Signal& from, double pull, double exactness) {
  const Eigen::ArrayXcd inverse = (symbol_ + pull * (1.0 + stretch_ * stretch_ * slope_))
                                      .inverse()
                                      .cast<std::complex<double>>();
  const auto preconditioned = [&](const Signal& x) {
    Signal out = convolved(x, inverse);
    out(0) = out(samples_ - 1) = 0.0;
    return out;
  };
  Signal b = right;
  b(0) = b(samples_ - 1) = 0.0;
  Signal x = from;
  x(0) = x(samples_ - 1) = 0.0;
  Signal r = b - hessian(x, pull), z = preconditioned(r), p = z;
  double rz = dot(r, z);
  const double enough = exactness * exactness * dot(b, b);
  for (int step = 0; step < kMaxSteps && dot(r, r) > enough && rz > 0.0; ++step) {
    const Signal hp = hessian(p, pull);
    const double along = rz / dot(p, hp);
    x += along * p;
    r -= along * hp;
    z = preconditioned(r);
    const double next = dot(r, z);
    p = z + (next / rz) * p;
    rz = next;
  }
  return x;
}

Signal NormOptimal::next(const Signal& u, const Signal& e) {
  const Signal right = times_t_transposed(times_t(u) + e) + rho_ * u;
  Signal best = solved(right, u, 0.0, kResidual);
  const double peak = limits_.peak, step = limits_.rate * h_;
  const auto obeys = [&](const Signal& x) {
    return x.abs().maxCoeff() <= peak && steps(x).abs().maxCoeff() <= step;
  };
  if (obeys(best)) return best;

  // Copies a of u' and s of its scaled steps obey the limits; a penalty pulls u' and the copies
  // together. The multipliers change only slightly from trial to trial.
  const double pull = kPenaltyShare * symbol_.maxCoeff(), most = stretch_ * step;
  if (owed_a_.size() == 0) owed_a_ = owed_s_ = Signal::Zero(samples_);
  Signal x = best, a, s;
  const auto settled = [](const Signal& miss, double bound) {
    return !std::isfinite(bound) || miss.abs().maxCoeff() <= kLimitTolerance * bound;
  };
  for (int round = 0; round < kMaxRounds; ++round) {
    a = (x + owed_a_).max(-peak).min(peak);
    s = (stretch_ * steps(x) + owed_s_).max(-most).min(most);
    x = solved(right + pull * (a - owed_a_ + stretch_ * steps_transposed(s - owed_s_)), x, pull,
               kRoundResidual);
    const Signal miss_a = x - a, miss_s = stretch_ * steps(x) - s;
    owed_a_ += miss_a;
    owed_s_ += miss_s;
    if (settled(miss_a, peak) && settled(miss_s, most)) break;
  }
  return limited(x, limits_, h_);
}

double NormOptimal::cost(const Signal& next, const Signal& u, const Signal& e) {
  const Signal change = next - u;
  return (e - times_t(change)).square().sum() + rho_ * change.square().sum() +
         dot(next, weighted(next));
}

}  // namespace servotwin
