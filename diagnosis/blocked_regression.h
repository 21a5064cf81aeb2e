// Linear least squares that is judged on blocks of time it was not fitted to.
//
//   y = B b + C c:  do the columns C earn their place beside B?
//
// Every block is predicted with the coefficients of the other blocks, with C and without. What
// comes by chance is told by the differences over pieces of a quarter of a second, and by a Wald
// test with a covariance that takes the pieces as clusters (Liang and Zeger 1986). What the other
// blocks do not show is held near the fit of B alone by 3 % of the information of all. Units of y.
// Any thread.
#pragma once

#include <Eigen/Core>
#include <vector>

namespace servotwin {

class BlockedRegression {
 public:
  /// Rows in the order of their times [s].
  BlockedRegression(Eigen::VectorXd y, const Eigen::VectorXd& time);

  /// Coefficients of all rows.
  [[nodiscard]] Eigen::VectorXd fit(const Eigen::MatrixXd& columns) const;
  /// The squares of every piece over the usual number of its rows, each predicted by the other
  /// blocks: their mean is the mean square.
  [[nodiscard]] std::vector<double> predicted(const Eigen::MatrixXd& base,
                                              const Eigen::MatrixXd& added = {}) const;
  /// z of the coefficients of `added` beside `base`.
  [[nodiscard]] double wald(const Eigen::MatrixXd& base, const Eigen::MatrixXd& added) const;

  /// What columns explain of the squared error beside a base.
  class Beside {
   public:
    Beside(const BlockedRegression& data, const Eigen::MatrixXd& base);
    [[nodiscard]] double explained(const Eigen::MatrixXd& columns) const;

   private:
    Eigen::MatrixXd basis_;
    Eigen::VectorXd left_;
  };

 private:
  struct Piece {
    Eigen::Index first = 0, count = 0;
    int block = 0;
  };
  Eigen::VectorXd y_;
  std::vector<Piece> pieces_;
};

}  // namespace servotwin
