#include "ilc/learning_law.h"

#include <algorithm>
#include <cmath>
#include <sstream>

#include "twin/two_pi.h"

namespace servotwin {
namespace {

constexpr double kFirst_hz = 0.1;
constexpr double kRatio = 1.015;  // from frequency to frequency

}  // namespace

double LearningLaw::q(double omega) const {
  if (!std::isfinite(bandwidth_hz)) return 1.0;
  const double beyond = std::pow(omega / (kTwoPi * bandwidth_hz), 4.0);
  if (law != Law::kNormOptimal) return 1.0 / (1.0 + beyond);
  const double square = std::norm(model.at(omega));
  return (square + weight) / (square * (1.0 + beyond) + weight);
}

std::complex<double> LearningLaw::l(double omega) const {
  switch (law) {
    case Law::kInverse:
      return gain / model.at(omega);
    case Law::kNormOptimal: {
      const std::complex<double> t = model.at(omega);
      return std::conj(t) / (std::norm(t) + weight);
    }
    case Law::kP:
      return gain;
    case Law::kPd:
      return gain * std::complex<double>(1.0, omega * derivative_s);
  }
  return 0.0;
}

Eigen::ArrayXd LearningLaw::q(const Eigen::ArrayXd& omega) const {
  return omega.unaryExpr([this](double w) { return q(w); });
}

Eigen::ArrayXcd LearningLaw::l(const Eigen::ArrayXd& omega) const {
  return omega.unaryExpr([this](double w) { return l(w); });
}

double ContractionCurve::most_at_hz() const {
  Eigen::Index at = 0;
  worst.maxCoeff(&at);
  return frequency_hz(at);
}

Eigen::ArrayXd frequencies_hz(double h) {
  const double nyquist = 0.5 / h;
  const auto count =
      static_cast<Eigen::Index>(std::log(nyquist / kFirst_hz) / std::log(kRatio)) + 2;
  return Eigen::ArrayXd::NullaryExpr(count, [&](Eigen::Index k) {
    return std::min(nyquist, kFirst_hz * std::pow(kRatio, static_cast<double>(k)));
  });
}

ContractionCurve contraction(const LearningLaw& law, std::span<const Transfer> models, double h) {
  ContractionCurve out;
  out.frequency_hz = frequencies_hz(h);
  out.of_model.resize(out.frequency_hz.size());
  out.worst.resize(out.frequency_hz.size());
  for (Eigen::Index k = 0; k < out.frequency_hz.size(); ++k) {
    const double omega = kTwoPi * out.frequency_hz(k), q = law.q(omega);
    const std::complex<double> l = law.l(omega);
    out.of_model(k) = q * std::abs(1.0 - l * law.model.at(omega));
    double worst = 0.0;
    for (const Transfer& t : models) worst = std::max(worst, std::abs(1.0 - l * t.at(omega)));
    out.worst(k) = q * worst;
  }
  return out;
}

double robust_bandwidth(LearningLaw law, std::span<const Transfer> models, double h,
                        double within) {
  // |1 - L T| does not depend on the bandwidth, and Q grows with it.
  law.bandwidth_hz = std::numeric_limits<double>::infinity();
  const ContractionCurve bare = contraction(law, models, h);
  const auto holds = [&](double bandwidth_hz) {
    law.bandwidth_hz = bandwidth_hz;
    for (Eigen::Index k = 0; k < bare.worst.size(); ++k) {
      if (law.q(kTwoPi * bare.frequency_hz(k)) * bare.worst(k) > within) return false;
    }
    return true;
  };
  double low = kMinBandwidth_hz, high = kMaxBandwidthOfNyquist * 0.5 / h;
  if (holds(high)) return high;
  if (!holds(low)) return 0.0;
  while (high > 1.0001 * low) {
    const double middle = std::sqrt(low * high);
    (holds(middle) ? low : high) = middle;
  }
  return low;
}

std::string why_refused(const LearningLaw& law, std::span<const Transfer> models, double h) {
  const ContractionCurve curve = contraction(law, models, h);
  if (curve.most() < 1.0) return {};
  std::ostringstream out;
  out.precision(3);
  out << "|Q (1 - L T)| reaches " << curve.most() << " at " << curve.most_at_hz()
      << " Hz for a model within the stated uncertainty, must stay below 1: learning would diverge "
         "there; ";
  const double bandwidth = robust_bandwidth(law, models, h);
  if (bandwidth > 0.0) {
    out << "take a bandwidth of at most " << bandwidth << " Hz";
  } else {
    out << "no bandwidth makes it safe: identify the model from richer motion, or use the model's "
           "inverse";
  }
  return out.str();
}

}  // namespace servotwin
