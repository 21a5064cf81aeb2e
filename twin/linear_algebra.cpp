#include "twin/linear_algebra.h"

#include <Eigen/Dense>
#include <unsupported/Eigen/MatrixFunctions>

namespace servotwin {

Eigen::VectorXd least_squares(const Eigen::MatrixXd& a, const Eigen::VectorXd& b) {
  return a.colPivHouseholderQr().solve(b);
}

struct LeastSquares::Decomposition {
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr;
};

LeastSquares::LeastSquares(const Eigen::MatrixXd& a)
    : decomposition_(std::make_unique<Decomposition>(Decomposition{a.colPivHouseholderQr()})) {}
LeastSquares::LeastSquares(LeastSquares&& other) noexcept = default;
LeastSquares& LeastSquares::operator=(LeastSquares&& other) noexcept = default;
LeastSquares::~LeastSquares() = default;

Eigen::VectorXd LeastSquares::solve(const Eigen::VectorXd& b) const {
  return decomposition_->qr.solve(b);
}

Eigen::MatrixXd orthonormal_basis(const Eigen::MatrixXd& a) {
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(a);
  return qr.householderQ() * Eigen::MatrixXd::Identity(a.rows(), qr.rank());
}

Eigen::MatrixXd triangle_of(const Eigen::MatrixXd& a) {
  return a.householderQr().matrixQR().topRows(a.cols()).triangularView<Eigen::Upper>();
}

Eigen::MatrixXd turned_by(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return a.householderQr().householderQ().transpose() * b;
}

Eigen::MatrixXd inverse(const Eigen::MatrixXd& a) { return a.inverse(); }

Eigen::MatrixXcd inverse(const Eigen::MatrixXcd& a) { return a.inverse(); }

Solved solve_square(const Eigen::MatrixXcd& a, const Eigen::VectorXcd& b) {
  const Eigen::PartialPivLU<Eigen::MatrixXcd> lu(a);
  return {lu.solve(b), lu.rcond()};
}

Eigen::VectorXd solve_symmetric(const Eigen::MatrixXd& a, const Eigen::VectorXd& b) {
  return a.ldlt().solve(b);
}

Eigen::MatrixXd solve_symmetric(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return a.ldlt().solve(b);
}

Eigen::MatrixXd inverse_symmetric(const Eigen::MatrixXd& a) {
  return a.ldlt().solve(Eigen::MatrixXd::Identity(a.rows(), a.cols()));
}

Eigen::VectorXd singular_values(const Eigen::MatrixXd& a) { return a.jacobiSvd().singularValues(); }

LeftSingular left_singular(const Eigen::MatrixXd& a) {
  const Eigen::JacobiSVD<Eigen::MatrixXd> svd(a, Eigen::ComputeThinU);
  return {svd.matrixU(), svd.singularValues()};
}

Eigen::VectorXcd eigenvalues(const Eigen::MatrixXd& a) { return a.eigenvalues(); }

Eigenpairs eigenpairs(const Eigen::MatrixXd& a) {
  const Eigen::EigenSolver<Eigen::MatrixXd> solver(a);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

Eigen::MatrixXd exponential(const Eigen::MatrixXd& a) { return a.exp(); }

}  // namespace servotwin
