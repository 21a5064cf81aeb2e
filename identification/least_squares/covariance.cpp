#include "identification/least_squares/covariance.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "twin/linear_algebra.h"

namespace servotwin {

namespace {

constexpr double kCorrelation_s = 0.05;
constexpr double kRidge = 1e-12;  // of unit columns: a parameter without effect stays finite

}  // namespace

Eigen::MatrixXd robust_covariance(const Eigen::MatrixXd& jacobian, const Eigen::VectorXd& residual,
                                  double h) {
  const Eigen::VectorXd scale = jacobian.colwise().norm().cwiseMax(1e-300).cwiseInverse();
  const Eigen::MatrixXd scaled = jacobian * scale.asDiagonal();
  Eigen::MatrixXd bread = scaled.transpose() * scaled;
  bread.diagonal().array() += kRidge;
  // Scores of one sample, and their covariance with those of neighbouring samples.
  const Eigen::MatrixXd scores = scaled.array().colwise() * residual.array();
  const Eigen::Index n = scores.rows();
  const Eigen::Index lags =
      std::min<Eigen::Index>(n / 4, static_cast<Eigen::Index>(std::ceil(kCorrelation_s / h)));
  Eigen::MatrixXd meat = scores.transpose() * scores;
  for (Eigen::Index lag = 1; lag <= lags; ++lag) {
    const double weight = 1.0 - static_cast<double>(lag) / static_cast<double>(lags + 1);
    const Eigen::MatrixXd cross = scores.topRows(n - lag).transpose() * scores.bottomRows(n - lag);
    meat += weight * (cross + cross.transpose());
  }
  const Eigen::MatrixXd inverse = inverse_symmetric(bread);
  return scale.asDiagonal() * (inverse * meat * inverse) * scale.asDiagonal();
}

}  // namespace servotwin
