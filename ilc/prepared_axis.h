// Prepares one axis for learning: the models within the uncertainty of its own, the law, and the
// largest bandwidth at which the iteration converges for all of them (ilc/learning_law.h,
// ilc/uncertainty.h).
//
// SI units. Any thread. Errors: std::runtime_error with the axis if there is no such bandwidth, or
// the law is not permitted.
#pragma once

#include <limits>
#include <string>

#include "ilc/learn.h"
#include "twin/loop_covariance.h"

namespace servotwin {

struct CorrectionWish {
  Law law = Law::kInverse;
  bool feedforward_only = false;  ///< the inverse of the model, without trials
  double bandwidth_hz = 0.0;      ///< of the learning law; 0: the largest that contracts
  /// No bandwidth is above it, that of the feed-forward included.
  double most_hz = std::numeric_limits<double>::infinity();
  double uncertainty_share = 0.0;  ///< of every pole and coefficient; 0: what the model states
  CorrectionLimits limits;
};

struct PreparedAxis {
  LearnAxis learning;
  ContractionCurve contraction;  ///< of |Q (1 - L T)|; without trials of |1 - Q L T|
  std::size_t models = 0;        ///< number of models within the uncertainty
  std::string uncertainty;       ///< what is assumed and where it comes from, in words
};

/// `model` must have the sampling time of `path`.
[[nodiscard]] PreparedAxis prepared_axis(const std::string& name, bool rotary, const Model& model,
                                         const StatedDeviations& stated, const Segment& path,
                                         const CorrectionWish& wish);

}  // namespace servotwin
