// The noise floor: the error that no model of this axis could predict.
//
//   white part        what the readings have between a quarter and a half of the sampling rate,
//                     where the motion of the axis is weakest: at rest and in motion, in blocks of
//                     36 rows. Creep, drift, tones, pushes and settling are no noise. At least
//                     step / sqrt(12), the rounding of the encoder
//   from lap to lap   RMS(e(t) - e(t + lap)) / sqrt(2) where the command repeats itself: what no
//                     model predicts from the command, white or not
//
// The noise floor is the larger one. Noise that the drive has filtered out of the band above is not
// seen. Source: docs/theory.md 8.
#pragma once

#include <vector>

#include "twin/sample.h"

namespace servotwin {

/// An RMS value with the interval that holds the true one with 95 % [m | rad]; NaN: not known.
struct RmsEstimate {
  double rms = kAbsent, low = kAbsent, high = kAbsent;
};

struct NoiseFloor : RmsEstimate {  ///< the larger one of `white` and `repeats`, > 0
  double encoder_step = 0.0;       ///< 0: not found
  RmsEstimate white, repeats;
  double lap_s = kAbsent;  ///< after which the command repeats
};

/// Any thread, any segments; a figure that the recording does not contain stays NaN.
/// `known_step`: of the encoder, from other motion of this axis; 0: sought in these segments.
[[nodiscard]] NoiseFloor noise_floor(const std::vector<Segment>& segments, double known_step = 0.0);

}  // namespace servotwin
