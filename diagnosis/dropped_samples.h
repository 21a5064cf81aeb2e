// Samples that the recording lost: rows that are not there, and encoder values that were held.
//
// A held value: the encoder says the same for some samples while the command moves, and then makes
// good for all of them at once. An axis that sticks starts slowly. Any thread.
#pragma once

#include <cstddef>
#include <vector>

#include "identification/recording/segments.h"

namespace servotwin {

struct DroppedSamples {
  std::size_t missing = 0;  ///< rows that were bridged when the recording was read
  std::size_t gaps = 0;     ///< longer ones, at which it was split
  std::size_t held = 0;     ///< samples
  /// A value or two that repeat may be how the axis moved.
  [[nodiscard]] bool any() const { return missing + gaps > 0 || held > 2; }
};

/// Counts them, and bridges the held ones in these segments.
[[nodiscard]] DroppedSamples bridge_dropped(SegmentedAxis& axis, double encoder_step);

}  // namespace servotwin
