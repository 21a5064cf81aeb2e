// A frequency response applied to a whole signal at once; it may be non-causal.
//
//   y = F^-1 (R(omega) F x)
//
// By FFT over at least twice the samples. The signal is placed in the middle and its first and last
// values are held on both sides, so that a response that looks ahead or back does not wrap around.
// This applies the inverse of a loop whose zeros are right of the imaginary axis: stable, but not
// causal. A real R >= 0 has zero phase.
//
// Responses are given on `omega()`, from 0 to the Nyquist frequency [rad/s]. Errors: none. One
// thread per object; allocates. Source: docs/theory.md 13.1.
#pragma once

#include <Eigen/Core>
#include <unsupported/Eigen/FFT>
#include <vector>

namespace servotwin {

class ZeroPhase {
 public:
  /// For signals of this many samples, h [s] apart.
  ZeroPhase(Eigen::Index samples, double h);

  [[nodiscard]] const Eigen::ArrayXd& omega() const { return omega_; }  ///< [rad/s]
  [[nodiscard]] Eigen::ArrayXd filtered(const Eigen::ArrayXd& signal,
                                        const Eigen::ArrayXcd& response);

 private:
  Eigen::Index samples_, padded_, before_;
  Eigen::ArrayXd omega_;
  Eigen::FFT<double> fft_;
  std::vector<double> time_;
  std::vector<std::complex<double>> spectrum_;
};

}  // namespace servotwin
