// The parts of vector fitting (vector_fitting.h): a rational function as the sum of simple
// fractions, its residues by least squares, and the relocation of its poles. Frequencies are in
// units of the mean frequency of the points. Any thread.
#pragma once

#include <Eigen/Core>
#include <complex>
#include <vector>

#include "identification/response/vector_fitting.h"

namespace servotwin {

/// s^2 + a s + b with a, b > 0, or s + b with b > 0.
struct Factor {
  bool pair = false;
  double a = 0.0, b = 0.0;

  [[nodiscard]] int poles() const { return pair ? 2 : 1; }
  [[nodiscard]] std::complex<double> at(std::complex<double> s) const {
    return pair ? s * (s + a) + b : s + b;
  }
};
using Factors = std::vector<Factor>;

[[nodiscard]] inline Factor pair_of(double omega, double zeta) {
  return {true, 2.0 * zeta * omega, omega * omega};
}
[[nodiscard]] int order_of(const Factors& factors);

/// The points in units of their mean frequency, a delay taken out of them.
struct WeightedResponse {
  WeightedResponse(const ResponsePoints& points, const RationalOptions& options);

  [[nodiscard]] Eigen::Index channels() const { return response.cols(); }

  double unit = 1.0;     ///< [rad/s]
  double overlap = 1.0;  ///< as of the points
  double size = 0.0;     ///< weighted squared response
  double least_width = 0.0;
  Eigen::VectorXcd s;
  Eigen::MatrixXcd response;
  Eigen::MatrixXd weight;  ///< 1 / deviation
};

/// Real parts above imaginary parts.
[[nodiscard]] Eigen::VectorXd stacked(const Eigen::VectorXcd& v);
[[nodiscard]] Eigen::MatrixXd stacked(const Eigen::MatrixXcd& m);

/// Columns, factor by factor: 1/(s + b), or s/(s^2 + a s + b) and 1/(s^2 + a s + b); the last is 1.
[[nodiscard]] Eigen::MatrixXcd basis_of(const Factors& factors, const Eigen::VectorXcd& s);

struct Residues {
  Eigen::MatrixXd coefficients;  ///< of the basis, a row per channel
  double cost = 0.0;             ///< sum of squared weighted errors
};

/// The best ones for these poles.
[[nodiscard]] Residues residues_of(const WeightedResponse& p, const Factors& factors);

/// One step of relaxed vector fitting: sigma G = a rational function with the poles of sigma in
/// every channel, the mean of sigma being 1 (Gustavsen 2006); the zeros of sigma, mirrored to the
/// left, are the new poles. Channels are reduced one by one (Deschrijver et al. 2008). Empty where
/// there is no finite solution.
[[nodiscard]] Factors relocated(const WeightedResponse& p, const Factors& factors);

}  // namespace servotwin
