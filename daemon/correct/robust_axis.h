// One axis made ready to learn: its model, how uncertain that is, and the bandwidth at which every
// model within the uncertainty contracts (ilc/learning_law.h, ilc/uncertainty.h).
//
// Any thread. Errors: std::runtime_error with the axis where no bandwidth is allowed.
#pragma once

#include <limits>
#include <string>

#include "identification/model/model_file.h"
#include "ilc/learn.h"

namespace servotwin::daemon {

struct RobustAxis {
  LearnAxis learning;
  std::string uncertainty;  ///< of its model, and where that is from, in words
};

/// By the inverse of the model. `record.model` must be at the cycle of `path`; no bandwidth of the
/// result is above `most_hz`.
[[nodiscard]] RobustAxis robust_axis(const ModelRecord& record, const Segment& path,
                                     const CorrectionLimits& limits,
                                     double most_hz = std::numeric_limits<double>::infinity());

}  // namespace servotwin::daemon
