// The models that a stated uncertainty allows.
//
//   (theta - theta_0)^T C^(-1) (theta - theta_0) <= deviations^2
//
// theta are the poles (real pole, natural frequency, damping), the coefficients of the tracking
// numerator and the delay; C is their covariance as the identification found it
// (twin/loop_covariance.h). They are estimated together: one of them off alone would have missed
// the recording by far more than the model did. Nothing else comes into it, and the path that is to
// be corrected least of all: it was not there when the model was found.
//
// Besides, the timing may be off by `timing_s` either way: what happens between the samples (held
// forces, velocities from differences, stamps) is in no model. T(0) stays 1.
//
// The models are the given one, the ends of the axes of the ellipsoid, and seeded draws from its
// surface, all with the timing early, right and late by turns: the same for the same input. Source:
// docs/theory.md 13.
//
// Any thread. Allocates.
#pragma once

#include <vector>

#include "ilc/transfer.h"
#include "twin/loop_covariance.h"

namespace servotwin {

struct TransferUncertainty {
  /// C, with the poles as their first label names them (labels_of); finite, positive semidefinite.
  LoopCovariance covariance = LoopCovariance::Zero();
  double timing_s = 0.0;    ///< a bound, not a deviation
  double deviations = 2.0;  ///< how many of them a model may be off
};

/// Of standard deviations one by one, as if each value could be off alone: where it is not known
/// how they hang together. NaN counts as 0.
[[nodiscard]] LoopCovariance one_by_one(const PoleSet& poles,
                                        const std::array<double, kMaxOrder>& numerator,
                                        double delay_s);

/// The same share of every pole and coefficient, for models that do not state their own.
[[nodiscard]] TransferUncertainty relative_uncertainty(const Transfer& transfer, double share);

/// All of them stable.
[[nodiscard]] std::vector<Transfer> models_within(const Transfer& transfer,
                                                  const TransferUncertainty& uncertainty,
                                                  int draws = 200);

}  // namespace servotwin
