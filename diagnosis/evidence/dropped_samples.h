// Detects samples that the recording lost: missing rows, and encoder values that were held.
//
// A held value: the encoder value stays constant for some samples while the command moves, and then
// jumps to the true position at once. (An axis that sticks starts slowly instead.) Any thread.
#pragma once

#include <cstddef>
#include <vector>

#include "identification/recording/segments.h"

namespace servotwin {

/// A recorder that loses more at once has been stopped and started: two captures, no loss.
inline constexpr double kLongestLoss_s = 1.0;

struct DroppedSamples {
  std::size_t missing = 0;  ///< missing rows, interpolated when the recording was read
  std::size_t gaps = 0;     ///< longer gaps, at which the recording was split, up to kLongestLoss_s
  std::size_t held = 0;     ///< samples with a held value
  /// Distance of held values from the motion: RMS over all samples of the recording [m | rad].
  double held_rms = 0.0;
  /// Whether samples were lost. One or two repeated values may be real motion, unless they alone
  /// make a larger error than the noise of the recording, `noise` [m | rad]; NaN: not known.
  [[nodiscard]] bool any(double noise) const {
    return missing + gaps > 0 || held > 2 || held_rms > noise;
  }
};

/// Counts the lost samples, and interpolates the held ones in these segments. `encoder_step`
/// [m | rad].
[[nodiscard]] DroppedSamples bridge_dropped(SegmentedAxis& axis, double encoder_step);

}  // namespace servotwin
