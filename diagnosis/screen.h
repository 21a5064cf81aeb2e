// How much of what a fit leaves one more effect could explain, for the whole catalogue at once and
// without fitting any of it (a score test; Rao 1948).
//
//   r  what the fit leaves,  J  all its derivatives (coefficients, poles, shapes),  C  the columns
//   of the candidate:   [J C] theta = r
//
// J is in the problem, so that neither the loop absorbs what is the candidate's nor the candidate
// what the loop could take up. The sums are kept by pieces of a quarter of a second, so that
// leaving out a block, and standard deviations that know of correlated residuals (Liang and Zeger
// 1986), cost next to nothing. One thread; no clock.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "identification/loop/projection.h"

namespace servotwin {

/// What one candidate of the catalogue is worth at the best point of its grid.
struct Screened {
  std::size_t kind = 0;
  std::vector<double> shapes;
  double gain = 0.0;       ///< share by which the squared error of left-out blocks falls
  double statistic = 0.0;  ///< z of its coefficients
  double p = 1.0;          ///< chance of coefficients as large, over all points looked at
};

class Screen {
 public:
  /// `data` at the optimum `at` of its structure; thinned data will do.
  Screen(const Projection& data, const Point& at);

  /// Beside a model that is held but for what `tangent` says: its columns are the derivatives of
  /// what is simulated, `left` what it misses; rows as in the segments.
  Screen(const std::vector<Signals>& segments, const Model& model, Eigen::VectorXd left,
         Eigen::MatrixXd tangent);

  [[nodiscard]] Screened look(std::size_t kind) const;
  /// Of columns that are no effect of the catalogue.
  [[nodiscard]] Screened look(const Eigen::MatrixXd& columns) const;

 private:
  struct Piece {
    Eigen::Index first = 0, count = 0;
    int block = 0;
  };
  struct Sums;
  [[nodiscard]] Eigen::MatrixXd columns(std::size_t kind, const std::vector<double>& shapes) const;
  [[nodiscard]] double explained(const Eigen::MatrixXd& columns) const;
  void judge(const Eigen::MatrixXd& columns, Screened& out) const;
  void judge_moment(std::size_t kind, Screened& out) const;
  [[nodiscard]] std::vector<std::vector<double>> grid(std::size_t kind) const;
  [[nodiscard]] std::vector<double> tones() const;
  [[nodiscard]] std::vector<double> moments(std::size_t kind, std::vector<double> shapes) const;

  void prepare();

  const std::vector<Signals>& segments_;
  Model model_;
  Eigen::VectorXd left_;     // r, 0 where nothing is judged
  Eigen::MatrixXd tangent_;  // J, unit columns
  Eigen::MatrixXd basis_;    // of the space of J, orthonormal
  std::vector<Piece> pieces_;
  double travel_ = 0.0, begin_s_ = 0.0, end_s_ = 0.0;
};

}  // namespace servotwin
