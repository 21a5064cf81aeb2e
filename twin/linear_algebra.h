// Decompositions of matrices whose size is known at run time only. Eigen compiles a decomposition
// anew in every file that names it, which takes ten seconds and more each; here it is compiled
// once.
//
// Not for the real-time path: they allocate. Any thread. Errors: none are thrown; a matrix with a
// number that is not finite gives a result that is not finite.
#pragma once

#include <Eigen/Core>
#include <memory>

namespace servotwin {

/// The x that minimises |a x - b|, by QR with column pivoting: a basic solution where the columns
/// of `a` depend on each other. Columns should be of like size.
[[nodiscard]] Eigen::VectorXd least_squares(const Eigen::MatrixXd& a, const Eigen::VectorXd& b);

/// The same for one `a` and many b.
class LeastSquares {
 public:
  explicit LeastSquares(const Eigen::MatrixXd& a);
  LeastSquares(LeastSquares&& other) noexcept;
  LeastSquares& operator=(LeastSquares&& other) noexcept;
  ~LeastSquares();
  [[nodiscard]] Eigen::VectorXd solve(const Eigen::VectorXd& b) const;

 private:
  struct Decomposition;
  std::unique_ptr<Decomposition> decomposition_;
};

/// Orthonormal columns that span those of `a`, as many as its numerical rank.
[[nodiscard]] Eigen::MatrixXd orthonormal_basis(const Eigen::MatrixXd& a);

/// The upper triangle R of a = Q R, as many rows as `a` has columns; rows(a) >= columns(a).
[[nodiscard]] Eigen::MatrixXd triangle_of(const Eigen::MatrixXd& a);

/// Q' b of a = Q R with a square Q: its last rows(a) - columns(a) rows are what `a` leaves of b.
[[nodiscard]] Eigen::MatrixXd turned_by(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);

/// a^-1 of a square matrix.
[[nodiscard]] Eigen::MatrixXd inverse(const Eigen::MatrixXd& a);
[[nodiscard]] Eigen::MatrixXcd inverse(const Eigen::MatrixXcd& a);

/// a^-1 b of a square matrix, and the reciprocal of its condition number, estimated.
struct Solved {
  Eigen::VectorXcd x;
  double reciprocal_condition = 0.0;
};
[[nodiscard]] Solved solve_square(const Eigen::MatrixXcd& a, const Eigen::VectorXcd& b);

/// a^-1 b of a symmetric positive semidefinite `a`, by L D L'.
[[nodiscard]] Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& a, const Eigen::VectorXd& b);
[[nodiscard]] Eigen::MatrixXd solve_symmetric(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b);
[[nodiscard]] Eigen::MatrixXd inverse_symmetric(const Eigen::MatrixXd& a);

/// From the largest to the smallest.
[[nodiscard]] Eigen::VectorXd singular_values(const Eigen::MatrixXd& a);

/// The left singular vectors as columns, with their values from the largest to the smallest; as
/// many as the smaller of rows and columns.
struct LeftSingular {
  Eigen::MatrixXd vectors;
  Eigen::VectorXd values;
};
[[nodiscard]] LeftSingular left_singular(const Eigen::MatrixXd& a);

/// Of a square matrix, in no order.
[[nodiscard]] Eigen::VectorXcd eigenvalues(const Eigen::MatrixXd& a);

/// Of a square matrix: its eigenvalues, in no order, and their vectors as columns of length 1.
struct Eigenpairs {
  Eigen::VectorXcd values;
  Eigen::MatrixXcd vectors;
};
[[nodiscard]] Eigenpairs eigenpairs(const Eigen::MatrixXd& a);

/// e^a of a square matrix, by scaling and squaring (Higham 2005).
[[nodiscard]] Eigen::MatrixXd exponential(const Eigen::MatrixXd& a);

}  // namespace servotwin
