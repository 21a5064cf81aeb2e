// The models within a stated uncertainty.
//
//   (theta - theta_0)^T C^(-1) (theta - theta_0) <= deviations^2
//
// theta contains the poles (real pole, natural frequency, damping), the coefficients of the
// tracking numerator and the delay. C is their covariance from the identification
// (twin/loop_covariance.h). They are estimated together: a change of one of them alone would have
// missed the recording by far more than the model did. The uncertainty does not depend on the path
// that is to be corrected.
//
// In addition, the timing may be off by `timing_s` either way, because no model contains what
// happens between the samples (held forces, velocities from differences, time stamps). T(0) stays
// 1.
//
// Of two masses the frequency and damping of the load, its share of the mass and the reset rate of
// the control are in theta too, independent of the loop. What is unstable with its spring is moved
// towards the given model until it is stable: the machine does not shake itself.
//
// The models are the given one, the ends of the axes of the ellipsoid, and seeded draws from its
// surface, with the timing early, right and late in turn: the same for the same input.
//
// Units: rad/s, s. Errors: none. Any thread. Allocates. Source: docs/theory.md 13.2.
#pragma once

#include <vector>

#include "ilc/transfer.h"
#include "twin/loop_covariance.h"

namespace servotwin {

struct TransferUncertainty {
  /// C, for the poles as in the first of labels_of; finite, positive semidefinite.
  LoopCovariance covariance = LoopCovariance::Zero();
  TwoMassDeviations two_masses;
  double timing_s = 0.0;    ///< a bound, not a standard deviation
  double deviations = 2.0;  ///< size of the ellipsoid in standard deviations
};

/// A diagonal covariance from standard deviations, for models whose correlations are unknown. NaN
/// counts as 0.
[[nodiscard]] LoopCovariance one_by_one(const PoleSet& poles,
                                        const std::array<double, kMaxOrder>& numerator,
                                        double delay_s);

/// The same relative deviation of every pole, coefficient and parameter of two masses, for models
/// without deviations.
[[nodiscard]] TransferUncertainty relative_uncertainty(const Transfer& transfer, double share);

/// The models; all are stable.
[[nodiscard]] std::vector<Transfer> models_within(const Transfer& transfer,
                                                  const TransferUncertainty& uncertainty,
                                                  int draws = 200);

}  // namespace servotwin
