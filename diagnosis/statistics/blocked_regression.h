// Linear least squares, judged by cross-validation over blocks of time.
//
//   y = B b + C c:  do the columns C improve the prediction beside B?
//
// Every block is predicted with coefficients fitted to the other blocks, with C and without.
// Whether the difference is significant is decided by a paired test over intervals of 0.25 s, and
// by a Wald test whose covariance treats these intervals as clusters (Liang and Zeger 1986).
// Coefficients that the other blocks do not determine are kept near the fit of B alone by 3 % of
// the information of all blocks. Units of y. Any thread.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "diagnosis/statistics/pieces.h"

namespace servotwin {

/// The x of gram x = right, of a symmetric positive semidefinite `gram` whose diagonal is raised by
/// kRidge of itself.
[[nodiscard]] Eigen::MatrixXd ridge_solved(const Eigen::MatrixXd& gram,
                                           const Eigen::MatrixXd& right);

class BlockedRegression {
 public:
  /// Rows in order of `time` [s].
  BlockedRegression(Eigen::VectorXd y, const Eigen::VectorXd& time);

  /// Coefficients fitted to all rows.
  [[nodiscard]] Eigen::VectorXd fit(const Eigen::MatrixXd& columns) const;
  /// Squared prediction errors of every interval of 0.25 s, each predicted by the other blocks and
  /// divided by the average number of rows of an interval: their mean is the mean square error.
  [[nodiscard]] std::vector<double> predicted(const Eigen::MatrixXd& base,
                                              const Eigen::MatrixXd& added = {}) const;
  /// z of the coefficients of `added` in a fit together with `base` (Wald test).
  [[nodiscard]] double wald(const Eigen::MatrixXd& base, const Eigen::MatrixXd& added) const;

  /// One coefficient with its standard deviation, and z by Student's t of that.
  struct Estimate {
    double value = 0.0, deviation = HUGE_VAL, z = 0.0;
  };
  /// The coefficient of `column` in a fit together with `base`; its covariance as for wald().
  [[nodiscard]] Estimate estimate(const Eigen::MatrixXd& base, const Eigen::VectorXd& column) const;

  /// The squared error that columns explain in addition to a base.
  class Beside {
   public:
    Beside(const BlockedRegression& data, const Eigen::MatrixXd& base);
    [[nodiscard]] double explained(const Eigen::MatrixXd& columns) const;

   private:
    Eigen::MatrixXd basis_;
    Eigen::VectorXd left_;
  };

 private:
  struct Last {
    Eigen::VectorXd theta;
    Eigen::MatrixXd covariance;
    double degrees = 1.0;
  };
  /// The last `count` coefficients of these columns, which have unit length.
  [[nodiscard]] Last last_of(const Eigen::MatrixXd& columns, Eigen::Index count) const;

  Eigen::VectorXd y_;
  std::vector<Piece> pieces_;
};

}  // namespace servotwin
