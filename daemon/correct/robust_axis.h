// Prepares one axis for learning: its model, the uncertainty of the model, and the largest
// bandwidth at which the iteration converges for every model within the uncertainty
// (ilc/learning_law.h, ilc/uncertainty.h).
//
// Any thread. Errors: std::runtime_error with the axis if there is no such bandwidth.
#pragma once

#include <limits>
#include <string>

#include "identification/model/model_file.h"
#include "ilc/learn.h"

namespace servotwin::daemon {

struct RobustAxis {
  LearnAxis learning;
  std::string uncertainty;  ///< of its model, in words, with where it comes from
};

/// The learning law is the inverse of the model. `record.model` must have the sampling time of
/// `path`; no bandwidth of the result is above `most_hz`.
[[nodiscard]] RobustAxis robust_axis(const ModelRecord& record, const Segment& path,
                                     const CorrectionLimits& limits,
                                     double most_hz = std::numeric_limits<double>::infinity());

}  // namespace servotwin::daemon
