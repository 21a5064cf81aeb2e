// The learning law u <- Q (u + L e) of an iteration, and whether it is permitted.
//
//   kInverse      L = gain / T                        Q = 1 / (1 + (f/f_c)^4)
//   kNormOptimal  L = T* / (|T|^2 + rho),   Q = (|T|^2 + rho) / (|T|^2 (1 + (f/f_c)^4) + rho)
//   kP            L = gain                            Q as of kInverse
//   kPd           L = gain (1 + s derivative)         Q as of kInverse
//
// Q has zero phase: a Butterworth filter of second order run forwards and backwards. That of the
// norm-optimal law follows from the weights of ilc/norm_optimal.h and tends to the same Q as rho ->
// 0. For a linear loop e_(j+1) = Q (1 - L T) e_j + (1 - Q) e_0, so the iteration converges
// monotonically if
//
//   max over the frequencies and over the models T_i within the uncertainty  |Q (1 - L T_i)| < 1
//
// The bandwidth f_c is the largest for which that maximum is at most kContraction. Two filters
// below 1/sqrt(2) still contract when they are mixed along time (ilc/reversals.h), since |w a + (1
// - w) b|^2 <= |a|^2 + |b|^2 for 0 <= w <= 1. Source: Bristow, Tharayil and Alleyne 2006;
// docs/theory.md 13.1 and 13.2.
//
// Angular frequencies in rad/s, others in Hz; `h` is the sampling time [s]. Errors: none. Any
// thread. Allocates.
#pragma once

#include <complex>
#include <span>
#include <string>
#include <vector>

#include "ilc/transfer.h"

namespace servotwin {

enum class Law { kInverse, kNormOptimal, kP, kPd };

/// Limit of |Q (1 - L T)| that is designed for: every trial at least halves the distance to
/// the error that remains (linear loop).
inline constexpr double kContraction = 0.5;

struct LearningLaw {
  Law law = Law::kInverse;
  Transfer model;             ///< T
  double bandwidth_hz = 0.0;  ///< f_c; infinite: Q = 1
  double gain = 1.0;
  double derivative_s = 0.0;  ///< kPd: factor of the derivative [s]
  double weight = 1e-3;       ///< kNormOptimal: rho, weight of the change from trial to trial

  [[nodiscard]] double q(double omega) const;
  [[nodiscard]] std::complex<double> l(double omega) const;
  /// Both for an array of frequencies [rad/s].
  [[nodiscard]] Eigen::ArrayXd q(const Eigen::ArrayXd& omega) const;
  [[nodiscard]] Eigen::ArrayXcd l(const Eigen::ArrayXd& omega) const;
};

/// |Q (1 - L T)| over the frequency: for the model itself, and the largest within the uncertainty.
struct ContractionCurve {
  Eigen::ArrayXd frequency_hz, of_model, worst;

  [[nodiscard]] double most() const { return worst.maxCoeff(); }
  [[nodiscard]] double most_at_hz() const;
};

/// Evaluated frequencies: from 0.1 Hz to the Nyquist frequency of `h`, logarithmically spaced.
[[nodiscard]] Eigen::ArrayXd frequencies_hz(double h);

[[nodiscard]] ContractionCurve contraction(const LearningLaw& law, std::span<const Transfer> models,
                                           double h);

/// The least bandwidth that robust_bandwidth gives [Hz].
inline constexpr double kMinBandwidth_hz = 0.5;
/// The largest bandwidth [Hz] for which the contraction is at most `within`, up to 0.8 of the
/// Nyquist frequency; 0 if not even kMinBandwidth_hz is possible.
[[nodiscard]] double robust_bandwidth(LearningLaw law, std::span<const Transfer> models, double h,
                                      double within = kContraction);

/// Why this law is not permitted: a sentence with figures and a remedy; empty if it is permitted.
[[nodiscard]] std::string why_refused(const LearningLaw& law, std::span<const Transfer> models,
                                      double h);

}  // namespace servotwin
