// How an iteration learns: u <- Q (u + L e), and whether it may.
//
//   kInverse      L = gain / T                        Q = 1 / (1 + (f/f_c)^4)
//   kNormOptimal  L = T* / (|T|^2 + rho),   Q = (|T|^2 + rho) / (|T|^2 (1 + (f/f_c)^4) + rho)
//   kP            L = gain                            Q as of kInverse
//   kPd           L = gain (1 + s derivative)         Q as of kInverse
//
// Q has zero phase. It is of a Butterworth filter of second order, run forwards and backwards; of
// the norm-optimal law it is what follows from the weights of ilc/norm_optimal.h, and becomes the
// same Q as rho -> 0. For a loop that is linear, e_(j+1) = Q (1 - L T) e_j + (1 - Q) e_0, so that
// the iteration converges monotonically where
//
//   max over the frequencies and over the models T_i within the uncertainty  |Q (1 - L T_i)| < 1
//
// The bandwidth f_c is the largest one for which that maximum is at most kContraction. Two filters
// that are below 1/sqrt(2) may be mixed along the time (ilc/reversals.h) and still contract, since
// |w a + (1 - w) b|^2 <= |a|^2 + |b|^2 for 0 <= w <= 1. Source: Bristow, Tharayil and Alleyne 2006;
// docs/theory.md 13.
//
// Any thread.
#pragma once

#include <complex>
#include <span>
#include <string>
#include <vector>

#include "ilc/transfer.h"

namespace servotwin {

enum class Law { kInverse, kNormOptimal, kP, kPd };

/// What |Q (1 - L T)| must stay below, for a margin: half of the error is gone with every trial.
inline constexpr double kContraction = 0.5;

struct LearningLaw {
  Law law = Law::kInverse;
  Transfer model;             ///< T
  double bandwidth_hz = 0.0;  ///< f_c; infinite: no Q
  double gain = 1.0;
  double derivative_s = 0.0;  ///< kPd
  double weight = 1e-3;       ///< kNormOptimal: rho, of the change from trial to trial

  [[nodiscard]] double q(double omega) const;
  [[nodiscard]] std::complex<double> l(double omega) const;
  /// Both over many frequencies [rad/s].
  [[nodiscard]] Eigen::ArrayXd q(const Eigen::ArrayXd& omega) const;
  [[nodiscard]] Eigen::ArrayXcd l(const Eigen::ArrayXd& omega) const;
};

/// |Q (1 - L T)| over the frequency: of the model itself and the worst within the uncertainty.
struct ContractionCurve {
  Eigen::ArrayXd frequency_hz, of_model, worst;

  [[nodiscard]] double most() const { return worst.maxCoeff(); }
  [[nodiscard]] double most_at_hz() const;
};

/// What is looked at: from 0.1 Hz to the Nyquist frequency of `h`, in steps of the same ratio.
[[nodiscard]] Eigen::ArrayXd frequencies_hz(double h);

[[nodiscard]] ContractionCurve contraction(const LearningLaw& law, std::span<const Transfer> models,
                                           double h);

/// The largest bandwidth for which the contraction is at most `within`, up to 0.8 of the Nyquist
/// frequency; 0 where not even kLeastBandwidth_hz is possible.
inline constexpr double kLeastBandwidth_hz = 0.5;
[[nodiscard]] double robust_bandwidth(LearningLaw law, std::span<const Transfer> models, double h,
                                      double within = kContraction);

/// Why this law must not be used, in a sentence with figures and what to do; empty: it may.
[[nodiscard]] std::string why_refused(const LearningLaw& law, std::span<const Transfer> models,
                                      double h);

}  // namespace servotwin
