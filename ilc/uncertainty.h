// The models that a stated uncertainty allows.
//
// Every pole (as real pole, natural frequency and damping), every coefficient of the tracking
// numerator and the delay may be off by `deviations` standard deviations, and the timing of the
// record by `timing_s` besides: what happens between the samples (held forces, velocities from
// differences, stamps) is in no model. T(0) stays 1. The models are the given one, those with one
// value at its bound, and seeded draws in between: the same for the same input.
//
// Any thread. Allocates.
#pragma once

#include <vector>

#include "ilc/transfer.h"

namespace servotwin {

/// Standard deviations; NaN counts as 0.
struct TransferUncertainty {
  PoleSet poles;                              ///< of the first label (labels_of)
  std::array<double, kMaxOrder> numerator{};  ///< c0..c(n-1)
  double delay_s = 0.0;
  double timing_s = 0.0;    ///< a bound, not a deviation
  double deviations = 2.0;  ///< how many of them a model may be off
};

/// The same share of every pole and coefficient, for models that do not state their own.
[[nodiscard]] TransferUncertainty relative_uncertainty(const Transfer& transfer, double share);

/// All of them stable.
[[nodiscard]] std::vector<Transfer> models_within(const Transfer& transfer,
                                                  const TransferUncertainty& uncertainty,
                                                  int draws = 200);

}  // namespace servotwin
