// The least squares problem of a multivariable fit at one point of its search: all linear
// parameters are projected out, for all outputs at once (docs/theory.md 15.3).
//
// Columns: for every pole its response to every input and its free response in every record; the
// inputs themselves; a constant per record. Inputs that are Maxwell elements change with their
// break distances. One thread at a time: an evaluation overwrites the columns of the last one.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "identification/response/multivariable.h"
#include "twin/hold.h"

namespace servotwin {

/// A point of the search.
struct MultivariablePlace {
  std::vector<bool> pair;             ///< of every pole
  std::vector<double> poles;          ///< of every pole log p, or log omega and log zeta
  std::vector<double> log_distances;  ///< of every input that is a Maxwell element, in their order
};

class MultivariableProblem {
 public:
  /// The first `share` of every record is fitted. `data` must outlive it.
  MultivariableProblem(const MultivariableData& data, double share);

  /// The residual of the best coefficients, outputs over their scale, and its derivative by the
  /// point of the search (Kaufman), one block of rows per output: by the poles, then by the
  /// distances.
  struct Left {
    Eigen::MatrixXd coefficients;  ///< one column per output
    Eigen::MatrixXd residual;      ///< rows x outputs
    Eigen::MatrixXd by_poles, by_distances;
  };
  struct Derivatives {
    bool by_poles = false, by_distances = false;
  };
  [[nodiscard]] Left solve(const MultivariablePlace& at, Derivatives wanted) const;

  /// Residual RMS of every output with these coefficients in free simulation of the records, from
  /// one share of each record to another, in the units of the outputs.
  [[nodiscard]] Eigen::ArrayXd judged(const MultivariablePlace& at,
                                      const Eigen::MatrixXd& coefficients, double from,
                                      double to) const;
  /// RMS about the mean of the response of each output to each source alone, there: outputs x
  /// sources.
  [[nodiscard]] Eigen::ArrayXXd parts_between(const MultivariablePlace& at,
                                              const Eigen::MatrixXd& coefficients, double from,
                                              double to) const;
  /// RMS of the outputs about their mean: there, and on the fitted part.
  [[nodiscard]] Eigen::ArrayXd spread_between(double from, double to) const;
  [[nodiscard]] Eigen::ArrayXd spread() const;

  void set_scale(const Eigen::ArrayXd& scale) { scale_ = scale; }
  [[nodiscard]] const Eigen::ArrayXd& scale() const { return scale_; }
  [[nodiscard]] Eigen::Index rows() const { return heads_.rows(); }
  [[nodiscard]] Eigen::Index outputs() const { return heads_.cols(); }
  [[nodiscard]] Eigen::Index inputs() const {
    return static_cast<Eigen::Index>(data_.inputs.size());
  }
  [[nodiscard]] Eigen::Index records() const { return static_cast<Eigen::Index>(courses_.size()); }
  [[nodiscard]] double sample_time_s() const { return data_.sample_time_s; }

 private:
  /// The inputs of one record as they are between samples.
  struct Course {
    std::vector<Spline> inputs;
    std::vector<Spline> by_distance;  // of every element, by the logarithm of its distance
    Eigen::Index size = 0, head = 0;  // samples, and how many of them are fitted
    [[nodiscard]] Eigen::Index count(bool whole) const { return whole ? size : head; }
  };
  void move_elements(const MultivariablePlace& at) const;
  void fill(const MultivariablePlace& at, bool whole, bool derivatives) const;
  void fill_pole(bool pair, const double* value, bool whole, Eigen::Ref<Eigen::MatrixXd> columns,
                 std::vector<Eigen::MatrixXd>* by) const;
  /// What moving one element does to every output with these coefficients.
  [[nodiscard]] Eigen::MatrixXd moved_by(std::size_t element, const MultivariablePlace& at,
                                         const Eigen::MatrixXd& coefficients) const;
  [[nodiscard]] Eigen::Index rows_of(bool whole) const;
  [[nodiscard]] Eigen::MatrixXd target_of(bool whole) const;
  [[nodiscard]] Eigen::MatrixXd between(const Eigen::MatrixXd& whole, double from, double to) const;

  const MultivariableData& data_;
  std::vector<std::size_t> elements_;  // which inputs they are
  Eigen::MatrixXd heads_;              // outputs where they are fitted
  Eigen::ArrayXd scale_;
  mutable std::vector<Course> courses_;
  mutable std::vector<double> log_distances_;  // that the courses have
  mutable Eigen::MatrixXd columns_;
  mutable std::vector<std::vector<Eigen::MatrixXd>> derivatives_;
};

/// RMS of every column.
[[nodiscard]] Eigen::ArrayXd rms_of(const Eigen::MatrixXd& columns);

}  // namespace servotwin
