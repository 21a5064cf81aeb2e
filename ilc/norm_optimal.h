// Norm-optimal learning in lifted form, within limits, without forming a matrix.
//
//   min over u'   |e - T (u' - u)|^2 + rho |u' - u|^2 + u'^T W u'
//   with          |u'_k| <= peak,  |u'_k - u'_(k-1)| <= rate h,  u'_0 = u'_(N-1) = 0
//
// T is the lower triangular Toeplitz matrix of the impulse response, W the one with symbol |T|^2
// (f/f_c)^4. Without limits, and apart from the ends, u' = Q (u + L e) of the law kNormOptimal
// (ilc/learning_law.h). Products with T and T^T are convolutions by FFT, systems are solved by
// conjugate gradients with a circulant preconditioner, and the limits by operator splitting
// (alternating directions; Boyd et al. 2011). Memory and time per iteration grow as N log N, never
// as N^2. T itself is singular to working precision for a few hundred samples; rho and W make the
// problem solvable.
//
// Units: u, e in m | rad, h in s. Errors: none. One thread per object; allocates. Source:
// docs/theory.md 13.4.
#pragma once

#include "ilc/learning_law.h"
#include "ilc/limits.h"
#include "ilc/zero_phase.h"

namespace servotwin {

class NormOptimal {
 public:
  /// `law` is of kind kNormOptimal. `samples` of every signal, h [s] apart.
  NormOptimal(const LearningLaw& law, const CorrectionLimits& limits, Eigen::Index samples,
              double h);

  /// The next correction, after `u` left the error `e`. It obeys the limits.
  [[nodiscard]] Eigen::ArrayXd next(const Eigen::ArrayXd& u, const Eigen::ArrayXd& e);
  /// The cost that is minimised, of a correction `next` after u and e.
  [[nodiscard]] double cost(const Eigen::ArrayXd& next, const Eigen::ArrayXd& u,
                            const Eigen::ArrayXd& e);

 private:
  using Signal = Eigen::ArrayXd;
  Signal convolved(const Signal& x, const Eigen::ArrayXcd& symbol);
  Signal times_t(const Signal& x) { return convolved(x, t_); }
  Signal times_t_transposed(const Signal& x) { return convolved(x, t_.conjugate()); }
  Signal weighted(const Signal& x) { return convolved(x, weight_); }
  /// Product with T^T T + rho + W + pull (1 + stretch^2 D^T D), the last term of the splitting; the
  /// ends are held at 0.
  Signal hessian(const Signal& x, double pull);
  Signal solved(const Signal& right, const Signal& from, double pull, double exactness);

  Eigen::Index samples_, padded_;
  double rho_, h_;
  double stretch_;  // scales differences to the size of values, at the bandwidth
  CorrectionLimits limits_;
  Eigen::FFT<double> fft_;
  std::vector<double> time_;
  std::vector<std::complex<double>> spectrum_;
  Eigen::ArrayXcd t_;       // of the impulse response
  Eigen::ArrayXcd weight_;  // of W
  Eigen::ArrayXd symbol_;   // of the circulant approximation of T^T T + rho + W
  Eigen::ArrayXd slope_;    // of D^T D
  Signal owed_a_, owed_s_;  // scaled multipliers of values and differences, of the last trial
};

}  // namespace servotwin
