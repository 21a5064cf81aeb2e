// A frequency response applied to a whole signal at once, causal or not.
//
//   y = F^-1 (R(omega) F x)
//
// By FFT over at least twice the samples: the signal stands in the middle, its first and last value
// are held on both sides, so that a response that looks ahead or behind does not wrap around. The
// inverse of a loop whose zeros are right of the imaginary axis is applied this way: stable, but
// not causal. A real R >= 0 moves nothing in time: zero phase.
//
// Responses are given on `omega()`, 0 to the Nyquist frequency. One thread per object; allocates.
#pragma once

#include <Eigen/Core>
#include <unsupported/Eigen/FFT>
#include <vector>

namespace servotwin {

class ZeroPhase {
 public:
  /// Of signals of so many samples, h [s] apart.
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
