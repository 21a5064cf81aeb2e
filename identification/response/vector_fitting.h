// Rational functions with common poles through frequency responses, and the modes among them.
//
//   G_c(s) = exp(-s tau) (d_c + sum_k r_ck / (s - p_k)),   s = j omega,   c: a channel
//
// Poles by relaxed vector fitting (Gustavsen and Semlyen 1999; Gustavsen 2006), poles on the right
// mirrored to the left, every equation weighted by the deviation of its point; then all parameters
// by weighted least squares (Levenberg-Marquardt), whose covariance gives the deviations. Pairs are
// s^2 + a s + b with a, b > 0 throughout: stable, and in real numbers. docs/theory.md 15.
//
// Frequencies in rad/s. Any thread.
#pragma once

#include <Eigen/Core>
#include <array>
#include <complex>
#include <optional>
#include <vector>

namespace servotwin {

/// What is to be fitted: one row per frequency, one column per channel.
struct ResponsePoints {
  Eigen::ArrayXd omega;       ///< [rad/s], > 0, increasing
  Eigen::MatrixXcd response;  ///< G
  Eigen::MatrixXd deviation;  ///< > 0, of the real and of the imaginary part
  /// Number of rows per independent one: 1 if they are independent (frequency_response.h).
  double overlap = 1.0;
};

/// A real pole at -omega (zeta is 1), or the pair s^2 + 2 zeta omega s + omega^2. A pair with zeta
/// above 1 is two real poles.
struct FittedPole {
  bool pair = false;
  double omega = 0.0, zeta = 1.0;
  double omega_deviation = 0.0, zeta_deviation = 0.0;
  /// Share of the weighted squared response that is lost without it, the residues of the others
  /// fitted anew, 0..1.
  double explains = 0.0;

  /// The standard deviations of frequency and damping are below a third of the values.
  [[nodiscard]] bool determined() const {
    return 3.0 * omega_deviation < omega && 3.0 * zeta_deviation < zeta;
  }
};

struct RationalFit {
  std::vector<FittedPole> poles;  ///< by how much they explain, the most first
  double delay_s = 0.0;           ///< tau
  /// One row per channel: of every pole, in the order above, c of c / (s + omega), or c1 and c0 of
  /// (c1 s + c0) / (s^2 + 2 zeta omega s + omega^2); then d.
  Eigen::MatrixXd coefficients;
  /// Mean of (fit - response)^2 / (2 deviation^2) per degree of freedom: near 1 where the
  /// deviations are true and the order is enough.
  double misfit = 0.0;

  [[nodiscard]] int order() const;  ///< number of poles
  [[nodiscard]] std::complex<double> at(Eigen::Index channel, double omega) const;
};

struct RationalOptions {
  double delay_s = 0.0;  ///< tau, known
  /// 2 zeta omega of a pair is at least this [rad/s]: a narrower resonance is not resolved by the
  /// points.
  double least_width = 0.0;
};

inline constexpr int kMaxPoles = 16;

/// Nothing where there are fewer points than parameters, or no finite fit. `order`
/// is 1..kMaxPoles.
[[nodiscard]] std::optional<RationalFit> fit_rational(const ResponsePoints& points, int order,
                                                      const RationalOptions& options = {});

/// Start values of a search in the time domain: the poles of orders 1 to `most` by vector fitting
/// alone, as far as there are enough points. A pair may be two real poles.
[[nodiscard]] std::vector<std::vector<FittedPole>> starting_poles(const ResponsePoints& points,
                                                                  int most);

/// The held-out misfit of one order.
struct OrderTrial {
  int order = 0;
  double held_out = 0.0;  ///< as RationalFit::misfit, over held-out points
  bool chosen = false;
};

struct ChosenFit {
  RationalFit fit;                 ///< to all of the points
  std::vector<OrderTrial> trials;  ///< by order
};

/// The simplest order, up to `most`, whose held-out misfit is within one standard error of the
/// least, by blocks of neighbouring frequencies. `halves` are estimated from different parts of
/// the records, at the same frequencies as `all`; each validates the fits to the other. Nothing
/// where no order can be fitted.
[[nodiscard]] std::optional<ChosenFit> fit_rational_order(
    const ResponsePoints& all, const std::array<ResponsePoints, 2>& halves, int most,
    const RationalOptions& options = {});

}  // namespace servotwin
