// A model with changes, whose values are fitted in free simulation while the rest of the model is
// fixed.
//
//   min sum (measured - simulated)^2 over the values of the changes   (Levenberg-Marquardt)
//
// Units: SI, rad for m on rotary axes. Any thread.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "diagnosis/search/change.h"
#include "twin/sample.h"

namespace servotwin {

/// Changes of a model, in the order in which they are applied, and their values.
struct Varied {
  std::vector<Change> changes;
  Eigen::VectorXd values;
  double cost = 1e300;         ///< sum of squared errors on the training data
  std::vector<double> pieces;  ///< mean squares over intervals of 0.25 s [m^2 | rad^2]

  void add(const Change& change);  ///< with the starting values of the change
  /// The same without the changes for which `which` is true.
  template <class Which>
  [[nodiscard]] Varied without(const Which& which) const {
    Varied out;
    Eigen::Index at = 0;
    for (const Change& change : changes) {
      const auto count = static_cast<Eigen::Index>(change.quantities.size());
      if (!which(change)) {
        out.add(change);
        out.values.tail(count) = values.segment(at, count);
      }
      at += count;
    }
    return out;
  }
  /// The model with these changes.
  [[nodiscard]] Model of(const Model& base) const { return of(base, values); }
  [[nodiscard]] Model of(const Model& base, const Eigen::VectorXd& at) const;
  /// d model / d value: a model whose parameters are the derivatives. By differences of the
  /// parameters, which are simple functions of the values.
  [[nodiscard]] Model direction(const Model& base, Eigen::Index value) const;
};

/// Fits the values of changes of a base model to training data.
class Variation {
 public:
  Variation(Model base, std::vector<Segment> training)
      : base_(std::move(base)), training_(std::move(training)) {}

  /// Fits the values, starting from the present ones. False where there is no valid model.
  [[nodiscard]] bool fit(Varied& v) const;
  /// Standard deviations of the values, robust against correlated residuals (sums over intervals of
  /// 0.25 s; docs/theory.md 4.4).
  [[nodiscard]] Eigen::VectorXd deviations(const Varied& v) const;
  /// The residual (measured minus simulated) of every sample of the training data, in order; 0
  /// during the first `settle_s` of every segment. Nothing where the model is not valid.
  [[nodiscard]] std::optional<Eigen::VectorXd> left(const Model& model, double settle_s) const;
  /// The derivatives of that residual with respect to the values from index `first` on.
  [[nodiscard]] std::optional<Eigen::MatrixXd> derivatives(const Varied& v, double settle_s,
                                                           Eigen::Index first = 0) const;

  [[nodiscard]] const Model& base() const { return base_; }
  [[nodiscard]] const std::vector<Segment>& training() const { return training_; }

 private:
  Model base_;
  std::vector<Segment> training_;
};

/// For every block of segments `v`, which was fitted to all of them, with the values that a fit to
/// the other blocks would find, by one Gauss-Newton step (least_squares/jackknife.h), shortened
/// where it is not valid or does not lower the cost of the other blocks. Where a short one does not
/// either, the block gets `v`; where one block cannot be simulated, all do.
[[nodiscard]] std::vector<Varied> left_out(const Model& base, const Varied& v,
                                           const std::vector<std::vector<Segment>>& blocks);

}  // namespace servotwin
