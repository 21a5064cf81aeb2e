// The noise floor: the error that no model of this axis could predict.
//
//   from repeats:     RMS(e(t) - e(t + lap)) / sqrt(2) where the command repeats itself
//   from standstill:  RMS of the encoder about cubics of 50 ms, at least 8 rows, while the command
//                     rests
//   from the encoder: step / sqrt(12)
//
// The noise floor is the largest of those that the recording contains. Each is a lower bound of the
// residual of a perfect model.
#pragma once

#include <vector>

#include "twin/sample.h"

namespace servotwin {

struct NoiseFloor {
  double rms = kAbsent;  ///< the largest of the three below [m | rad], > 0; NaN if the recording
                         ///< contains none
  double encoder_step = 0.0;  ///< 0: not found
  double standstill_rms = kAbsent;
  double repeat_rms = kAbsent;
  double lap_s = kAbsent;  ///< after which the command repeats
};

/// Any thread, any segments; a figure that the recording does not contain stays NaN.
[[nodiscard]] NoiseFloor noise_floor(const std::vector<Segment>& segments);

}  // namespace servotwin
