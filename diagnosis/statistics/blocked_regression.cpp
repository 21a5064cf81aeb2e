#include "diagnosis/statistics/blocked_regression.h"

#include <Eigen/Dense>
#include <cmath>

#include "diagnosis/statistics/chance.h"
#include "twin/linear_algebra.h"

namespace servotwin {

namespace {

// Of the diagonal, against singular matrices, in what a column explains beside a base.
constexpr double kRidgeBesideBase = 1e-7;

/// The columns scaled to unit length, and their former lengths.
Eigen::MatrixXd scaled(const Eigen::MatrixXd& columns, Eigen::VectorXd* length = nullptr) {
  Eigen::VectorXd norms = columns.colwise().norm();
  for (double& norm : norms) norm = norm > 0.0 ? norm : 1.0;
  if (length != nullptr) *length = norms;
  return columns * norms.cwiseInverse().asDiagonal();
}

/// Both next to each other; `added` may be empty.
Eigen::MatrixXd beside(const Eigen::MatrixXd& base, const Eigen::MatrixXd& added) {
  Eigen::MatrixXd out(base.rows(), base.cols() + added.cols());
  out.leftCols(base.cols()) = base;
  if (added.cols() > 0) out.rightCols(added.cols()) = added;
  return out;
}

}  // namespace

Eigen::MatrixXd ridge_solved(const Eigen::MatrixXd& gram, const Eigen::MatrixXd& right) {
  if (gram.size() == 0) return right;
  Eigen::MatrixXd ridged = gram;
  ridged.diagonal() += kRidge * gram.diagonal().cwiseMax(1e-300);
  return solve_symmetric(ridged, right);
}

BlockedRegression::BlockedRegression(Eigen::VectorXd y, const Eigen::VectorXd& time)
    : y_(std::move(y)) {
  const auto piece_at = [&](Eigen::Index k) { return std::floor(time(k) / kPiece_s); };
  for (Eigen::Index k = 0; k < y_.size();) {
    Eigen::Index end = k;
    while (end < y_.size() && piece_at(end) == piece_at(k)) ++end;
    pieces_.push_back({k, end - k, 0});
    k = end;
  }
  for (Piece& piece : pieces_)
    piece.block =
        static_cast<int>(piece.first * kRegressionBlocks / std::max<Eigen::Index>(1, y_.size()));
}

Eigen::VectorXd BlockedRegression::fit(const Eigen::MatrixXd& columns) const {
  Eigen::VectorXd length;
  const Eigen::MatrixXd a = scaled(columns, &length);
  return ridge_solved(a.transpose() * a, a.transpose() * y_).cwiseQuotient(length);
}

std::vector<double> BlockedRegression::predicted(const Eigen::MatrixXd& base,
                                                 const Eigen::MatrixXd& added) const {
  // Coefficients that the other blocks do not determine stay near the fit of the base to all rows.
  const Eigen::VectorXd y = y_ - base * fit(base);
  const Eigen::MatrixXd a = scaled(beside(base, added));
  const Eigen::MatrixXd gram = a.transpose() * a;
  const Eigen::VectorXd right = a.transpose() * y;
  // Average number of rows: an interval mostly at rest has few rows and counts accordingly.
  const double usual = static_cast<double>(y_.size()) / static_cast<double>(pieces_.size());
  std::vector<double> out(pieces_.size());
  for (int b = 0; b < kRegressionBlocks; ++b) {
    Eigen::MatrixXd g = (1.0 + kPriorWeight) * gram;
    Eigen::VectorXd x = right;
    for (const Piece& piece : pieces_) {
      if (piece.block != b) continue;
      const auto part = a.middleRows(piece.first, piece.count);
      g -= part.transpose() * part;
      x -= part.transpose() * y.segment(piece.first, piece.count);
    }
    const Eigen::VectorXd theta = ridge_solved(g, x);
    for (std::size_t i = 0; i < pieces_.size(); ++i) {
      const Piece& piece = pieces_[i];
      if (piece.block != b) continue;
      out[i] =
          (y.segment(piece.first, piece.count) - a.middleRows(piece.first, piece.count) * theta)
              .squaredNorm() /
          usual;
    }
  }
  return out;
}

BlockedRegression::Last BlockedRegression::last_of(const Eigen::MatrixXd& a,
                                                   Eigen::Index count) const {
  const Eigen::MatrixXd gram = a.transpose() * a;
  const Eigen::VectorXd theta = ridge_solved(gram, a.transpose() * y_);
  const Eigen::VectorXd left = y_ - a * theta;
  const Eigen::Index n = a.cols();
  Eigen::MatrixXd scores = Eigen::MatrixXd::Zero(n, n);
  for (const Piece& piece : pieces_) {
    const Eigen::VectorXd s =
        a.middleRows(piece.first, piece.count).transpose() * left.segment(piece.first, piece.count);
    scores += s * s.transpose();
  }
  const auto m = static_cast<double>(pieces_.size());
  Last out;
  out.degrees = std::max(1.0, m - static_cast<double>(n));
  const Eigen::MatrixXd inverse = ridge_solved(gram, Eigen::MatrixXd::Identity(n, n));
  out.covariance = (inverse * scores * inverse).bottomRightCorner(count, count) * (m / out.degrees);
  out.theta = theta.tail(count);
  return out;
}

double BlockedRegression::wald(const Eigen::MatrixXd& base, const Eigen::MatrixXd& added) const {
  const Last last = last_of(scaled(beside(base, added)), added.cols());
  const auto q = static_cast<double>(added.cols());
  const double ratio = last.theta.dot(solve_symmetric(last.covariance, last.theta)) / q;
  return std::isfinite(ratio) && ratio > 0.0 ? z_of_f_ratio(ratio, q, last.degrees) : 0.0;
}

BlockedRegression::Estimate BlockedRegression::estimate(const Eigen::MatrixXd& base,
                                                        const Eigen::VectorXd& column) const {
  const double length = column.norm();
  if (!(length > 0.0)) return {};
  const Last last = last_of(scaled(beside(base, column)), 1);
  const double deviation = std::sqrt(last.covariance(0, 0));
  return {last.theta(0) / length, deviation / length,
          z_of_t(last.theta(0) / deviation, last.degrees)};
}

BlockedRegression::Beside::Beside(const BlockedRegression& data, const Eigen::MatrixXd& base)
    : left_(data.y_) {
  basis_ = orthonormal_basis(scaled(base));
  left_ -= basis_ * (basis_.transpose() * data.y_);
}

double BlockedRegression::Beside::explained(const Eigen::MatrixXd& columns) const {
  const Eigen::MatrixXd c = columns - basis_ * (basis_.transpose() * columns);
  Eigen::MatrixXd gram = c.transpose() * c;
  // A column inside the space of the base explains only rounding errors.
  for (Eigen::Index i = 0; i < c.cols(); ++i)
    gram(i, i) += kRidgeBesideBase * columns.col(i).squaredNorm() + 1e-300;
  const Eigen::VectorXd right = c.transpose() * left_;
  return right.dot(solve_symmetric(gram, right));
}

}  // namespace servotwin
