#include "identification/least_squares/gram_solver.h"

namespace servotwin {

GramSolver::GramSolver(const Eigen::MatrixXd& r) : r_(r) {
  const Eigen::Index n = r.cols();
  Eigen::MatrixXd gram = Eigen::MatrixXd::Zero(n, n);
  gram.selfadjointView<Eigen::Lower>().rankUpdate(r.transpose());
  scale_ = gram.diagonal().cwiseSqrt();
  for (double& s : scale_) s = s > 0.0 ? 1.0 / s : 0.0;
  gram_ = scale_.asDiagonal() * Eigen::MatrixXd(gram.selfadjointView<Eigen::Lower>()) *
          scale_.asDiagonal();
  // Columns that are not there (all zero) keep a unit pivot; the ridge is far below any measured
  // digit.
  for (Eigen::Index i = 0; i < n; ++i) gram_(i, i) = 1.0 + 1e-13;
  active_.assign(static_cast<std::size_t>(n), true);
  factorise();
}

void GramSolver::drop(Eigen::Index column) {
  active_[static_cast<std::size_t>(column)] = false;
  factorise();
}

Eigen::VectorXd GramSolver::take_out(Eigen::Ref<Eigen::VectorXd> b) const {
  Eigen::VectorXd x = Eigen::VectorXd::Zero(r_.cols());
  for (int round = 0; round < 2; ++round) {
    Eigen::VectorXd right = (scale_.array() * (r_.transpose() * b).array()).matrix();
    mask(right);
    Eigen::VectorXd dx = factor_.solve(right);
    mask(dx);
    dx.array() *= scale_.array();
    b.noalias() -= r_ * dx;
    x += dx;
  }
  return x;
}

void GramSolver::mask(Eigen::VectorXd& v) const {
  for (std::size_t i = 0; i < active_.size(); ++i) {
    if (!active_[i]) v(static_cast<Eigen::Index>(i)) = 0.0;
  }
}

void GramSolver::factorise() {
  Eigen::MatrixXd g = gram_;
  for (std::size_t i = 0; i < active_.size(); ++i) {
    if (active_[i]) continue;
    const auto k = static_cast<Eigen::Index>(i);
    g.row(k).setZero();
    g.col(k).setZero();
    g(k, k) = 1.0;
  }
  factor_.compute(g);
}

}  // namespace servotwin
