// Least squares for problems with many rows and few columns; columns can be excluded.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <vector>

namespace servotwin {

/// Least squares by the Gram matrix of unit-norm columns, with one round of refinement: twice as
/// fast as QR on tall problems, and as exact where the scaled columns are not degenerate.
class GramSolver {
 public:
  /// `r` must outlive the solver.
  explicit GramSolver(const Eigen::MatrixXd& r);
  /// Excludes a column from all later solutions.
  void drop(Eigen::Index column);
  /// The least squares solution for `b`, which is replaced by the residual.
  Eigen::VectorXd take_out(Eigen::Ref<Eigen::VectorXd> b) const;

 private:
  void mask(Eigen::VectorXd& v) const;
  void factorise();

  const Eigen::MatrixXd& r_;
  Eigen::VectorXd scale_;
  Eigen::MatrixXd gram_;
  std::vector<bool> active_;
  Eigen::LDLT<Eigen::MatrixXd> factor_;
};

}  // namespace servotwin
