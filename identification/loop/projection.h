// Variable projection: for given poles and shape parameters the error is linear in all other
// parameters.
//
//   e ~ sum_j c_j s^(n-j)/P x_r + sum_k (alpha_k s + beta_k)/M_k s x_r
//       + sum_i d_i G(s) f_i(motion; shape_i) + free response of every segment
//
// G is s/P or 1/P and what the modes make of a disturbance (twin/loop.h).
//
// The linear parameters are solved by least squares and projected out. The remaining cost depends
// on the denominator a1..an, the shapes, and omega, zeta, gamma, delta of every mode; its gradient
// is exact. Sources: thesis 3.5; Golub and Pereyra 1973; Kaufman 1975 (docs/theory.md 4). The
// filters are those of twin/hold.h.
//
// Units: m or rad, s. Const members may be called from several threads at once. Allocates.
#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "identification/loop/force_filter.h"
#include "identification/recording/signals.h"
#include "twin/model.h"

namespace servotwin {

/// The loop and the effects that a fit uses.
struct Structure {
  int order = 3;                     ///< 2 or 3
  std::vector<std::size_t> effects;  ///< places in the catalogue
  bool matched_feedforward = false;  ///< no velocity error: the last tracking coefficient is 0
  bool every_coefficient = false;    ///< include coefficients that a free loop already contains:
                                     ///< only for a loop that is held fixed
  int modes = 0;                     ///< number of modes of vibration
  /// The modes depend on position. Only the refinement in free simulation (output_error.h) uses
  /// this; a projection treats them as constant.
  bool moving = false;

  /// Shape parameters of all effects, and coefficients that a free loop leaves identifiable.
  [[nodiscard]] int shape_count() const;
  [[nodiscard]] int coefficient_count() const;
};

/// The nonlinear parameters.
struct Point {
  std::array<double, kMaxOrder> denominator{};
  std::vector<double> shapes{};  ///< in the order of the structure
  std::vector<Mode> modes{};     ///< alpha and beta are linear and not read here
};

/// The motion that is passed to an effect which acts so, sample by sample.
[[nodiscard]] std::vector<Motion> motion_along(const Signals& signals, const Spline& command,
                                               Acts acts);

/// What every effect is passed of one segment with one command.
class MotionsSeen {
 public:
  /// `by_loop`: for effects on the reading as well, which may see another motion.
  MotionsSeen(const Signals& signals, const Spline& command, bool by_loop);

  [[nodiscard]] const std::vector<Motion>& of(Acts acts) const {
    return acts == Acts::kReading && !by_loop_.empty() ? by_loop_ : by_reading_;
  }

 private:
  // The latter is empty where the loop's position is not known, or nobody asks for it.
  std::vector<Motion> by_reading_, by_loop_;
};

class Projection {
 public:
  /// `free_response`: add the free response of an unknown starting state of every segment as
  /// columns. False only where the segments are known to start at rest.
  Projection(std::vector<Signals> segments, Structure structure, bool free_response = true);

  struct Solution {
    Eigen::VectorXd linear;    ///< c0.., effect coefficients, alpha, beta.., free responses
    Eigen::VectorXd residual;  ///< e - R linear
    double cost = 0.0;         ///< half the sum of squares
    bool clamped = false;      ///< a coefficient was set to its lower bound 0
  };
  [[nodiscard]] Solution solve(const Point& point) const;

  /// Kaufman's Jacobian of the residual. Columns: a1..an, the shapes, then omega, zeta, gamma,
  /// delta of every mode. The gradient J^T r is exact.
  struct Linearised {
    Solution at;
    Eigen::MatrixXd jacobian;
  };
  [[nodiscard]] Linearised linearise(const Point& point) const;

  /// The regressors, unscaled and without free responses.
  [[nodiscard]] Eigen::MatrixXd regressors(const Point& point) const;
  /// Unprojected Jacobian by all parameters: the linear ones, then those of `linearise`.
  /// Covariances are computed from it.
  [[nodiscard]] Eigen::MatrixXd full_jacobian(const Point& point,
                                              const Eigen::VectorXd& linear) const;

  [[nodiscard]] Eigen::Index rows() const { return rows_; }
  /// Number of columns of c0.., effect coefficients, alpha, beta of every mode.
  [[nodiscard]] Eigen::Index model_columns() const;
  [[nodiscard]] bool has_free_response() const { return free_response_; }
  [[nodiscard]] const Structure& structure() const { return structure_; }
  [[nodiscard]] const std::vector<Signals>& segments() const { return segments_; }
  /// The model with these nonlinear and linear parameters.
  [[nodiscard]] Model model_of(const Point& point, const Eigen::VectorXd& linear) const;

 private:
  struct Columns;  // regressors and, where requested, the data for their derivatives
  template <int N>
  void fill(const Point& point, bool derivatives, Columns& columns) const;
  template <int N, class Bank>
  void fill_free(const Bank& bank, Columns& columns, const Signals& s, Eigen::Index row0,
                 Eigen::Index first, bool derivatives, const Mode* mode) const;
  /// Sets the rows of lead-ins to 0.
  void leave_out_leads(Columns& columns, bool derivatives) const;
  [[nodiscard]] Eigen::VectorXd& column_of(Columns& columns, int slot, int shape, bool first) const;
  [[nodiscard]] const Columns& columns_at(const Point& point, bool derivatives) const;
  [[nodiscard]] Eigen::MatrixXd derivatives_of_sum(const Columns& columns,
                                                   const Eigen::VectorXd& linear) const;
  [[nodiscard]] Solution project(const Columns& columns) const;

  std::vector<Signals> segments_;
  Structure structure_;
  bool free_response_ = true;
  Eigen::Index rows_ = 0;
  // One entry per identifiable coefficient: the index of its effect in the structure, and its index
  // in the effect.
  struct Slot {
    std::size_t effect = 0, coefficient = 0;
    bool non_negative = false;
  };
  std::vector<Slot> slots_;
  std::vector<std::size_t> shape_offset_;  // of each effect in Point::shapes
  int delay_shape_ = -1;                   // place of the command delay in Point::shapes
  bool acts_along_motion_ = false, acts_on_reading_ = false;  // any effect
  // The motion that effects see in each segment; empty where a delay that is searched moves the
  // command, or where no effect acts along it.
  std::vector<MotionsSeen> motions_;
};

}  // namespace servotwin
