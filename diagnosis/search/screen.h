// Screening: how much of the residual of a fit one more effect could explain, for the whole
// catalogue and without fitting any effect (a score test; Rao 1948).
//
//   r  residual of the fit,  J  all its derivatives (coefficients, poles, shape parameters),
//   C  columns of the candidate:   [J C] theta = r
//
// Since J is part of the problem, the candidate is not credited with what the loop could absorb.
// The sums are kept for intervals of 0.25 s, so that leaving out a block, and standard deviations
// that are robust against correlated residuals (Liang and Zeger 1986), need no further pass over
// the data. One thread; no clock.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "diagnosis/statistics/pieces.h"
#include "identification/loop/effect_columns.h"
#include "identification/loop/projection.h"

namespace servotwin {

/// How much one candidate of the catalogue explains at the best point of its grid.
struct Screened {
  std::size_t kind = 0;
  std::vector<double> shapes;
  double gain = 0.0;       ///< share by which the squared error of left-out blocks falls
  double statistic = 0.0;  ///< z of its coefficients
  double p = 1.0;          ///< one-sided, corrected for the number of points of the grid
};

class Screen {
 public:
  /// Screens against a fit of `data` with its optimum at `at`; thinned data are accurate enough.
  /// `encoder_step`: a few of them are no period of position [m | rad]; 0: not known.
  Screen(const Projection& data, const Point& at, double encoder_step);

  /// The same for a model whose simulation leaves `left`, one value per row of `data`.
  Screen(const Projection& data, const Point& at, const Model& model, Eigen::VectorXd left,
         double encoder_step);

  /// Screens against a model that is fixed except for the parameters in `tangent`, whose columns
  /// are the derivatives of the simulated error. `left`: the residual. Both have the rows of the
  /// segments.
  Screen(const std::vector<Signals>& segments, const Model& model, Eigen::VectorXd left,
         Eigen::MatrixXd tangent);

  /// The result for an effect of the catalogue.
  [[nodiscard]] Screened look(std::size_t kind) const;
  /// The result for given columns, of anything that is not in the catalogue.
  [[nodiscard]] Screened look(const Eigen::MatrixXd& columns) const;

 private:
  struct Sums;
  [[nodiscard]] Eigen::MatrixXd columns(std::size_t kind, const std::vector<double>& shapes) const;
  [[nodiscard]] double explained(const Eigen::MatrixXd& columns) const;
  void judge(const Eigen::MatrixXd& columns, Screened& out) const;
  void judge_moment(std::size_t kind, Screened& out) const;
  [[nodiscard]] std::vector<std::vector<double>> grid(std::size_t kind) const;
  [[nodiscard]] double shortest_period() const;
  [[nodiscard]] std::vector<double> tones() const;
  [[nodiscard]] std::vector<double> moments(std::size_t kind, std::vector<double> shapes) const;

  void take_tangent(const Projection& data, const Point& at, const Eigen::VectorXd& linear);
  void prepare();

  const std::vector<Signals>& segments_;
  Model model_;
  std::optional<EffectColumns> beside_;  // columns of candidates beside the model
  Eigen::VectorXd left_;                 // r; 0 in samples that are not used
  Eigen::MatrixXd tangent_;              // J, unit columns
  Eigen::MatrixXd basis_;                // of the space of J, orthonormal
  std::vector<Piece> pieces_;
  double travel_ = 0.0, begin_s_ = 0.0, end_s_ = 0.0, encoder_step_ = 0.0;
};

/// What the simulation of a model leaves, one value per row of thinned data of these segments.
[[nodiscard]] Eigen::VectorXd left_by_simulation(const Projection& coarse,
                                                 const std::vector<Segment>& segments,
                                                 const Model& model);

}  // namespace servotwin
