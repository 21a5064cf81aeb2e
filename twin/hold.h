// Exact discretisation of a linear system whose input is a polynomial within each step.
//
//   w' = A w + B u,   u(t_n + s) = sum_k u_n^(k) s^k / k!,  k = 0..m
//   w_(n+1) = Phi w_n + sum_k G_k u_n^(k)
//
// by one matrix exponential of the system augmented with a chain of integrators (van Loan 1978;
// docs/theory.md 2.1). m = 0 is the zero-order hold, m = 1 the first-order hold. Commands are the
// piecewise cubic of a C2 spline; its first derivative (m = 2) drives the filters, so that an axis
// at rest is the zero state.
//
// Times in s. Errors: none. Allocates. Any thread.
#pragma once

#include <Eigen/Core>

namespace servotwin {

struct Hold {
  Eigen::MatrixXd phi;  ///< n x n
  Eigen::MatrixXd g;    ///< n x (m + 1); column k multiplies the k-th derivative of the input
};

/// Discretises for the step h [s] > 0, for states that are derivatives of each other. Allocates.
[[nodiscard]] Hold discretise(const Eigen::MatrixXd& a, const Eigen::VectorXd& b, double h, int m);
/// The same for states of like size whose fastest rate is `rate` [1/s].
[[nodiscard]] Hold discretise_alike(const Eigen::MatrixXd& a, const Eigen::VectorXd& b, double h,
                                    int m, double rate);

/// The derivatives of both for a change of `a` and `b` at the rates `da` and `db`.
[[nodiscard]] Hold discretise_derivative(const Eigen::MatrixXd& a, const Eigen::VectorXd& b,
                                         const Eigen::MatrixXd& da, const Eigen::VectorXd& db,
                                         double h, int m);
[[nodiscard]] Hold discretise_alike_derivative(const Eigen::MatrixXd& a, const Eigen::VectorXd& b,
                                               const Eigen::MatrixXd& da, const Eigen::VectorXd& db,
                                               double h, int m, double rate);

/// The C2 cubic spline through equidistant samples, in the form that the hold uses: value and three
/// derivatives at the start of every interval. The last row continues the last interval.
struct Spline {
  double h = 0.0;
  Eigen::ArrayXd value, first, second, third;

  /// With given end slopes; 0 for a motion that starts and ends at rest.
  static Spline through(const Eigen::ArrayXd& samples, double h, double slope_begin,
                        double slope_end);
  /// With the end slopes of the cubics through the first and the last four samples, for a segment
  /// that is cut out of a motion.
  static Spline through(const Eigen::ArrayXd& samples, double h);
  /// Linear between the samples.
  static Spline straight(const Eigen::ArrayXd& samples, double h);
  /// The samples of the same motion delayed by `delay_s` >= 0, extrapolated before the start with
  /// the first slope.
  [[nodiscard]] Eigen::ArrayXd delayed(double delay_s) const;
  /// d delayed / d delay_s.
  [[nodiscard]] Eigen::ArrayXd delayed_derivative(double delay_s) const;
};

}  // namespace servotwin
