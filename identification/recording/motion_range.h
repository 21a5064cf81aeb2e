// How fast a motion is: what a model was found on, and what a path asks for.
//
//   speed        max |x(t + d) - x(t)| / d
//   acceleration max |x(t + d) - 2 x(t) + x(t - d)| / d^2,   d = kSpan_s
//
// Over a span and not from sample to sample: the steps of an encoder or of a table's digits are no
// motion (1 um is 0.04 m/s^2 over 10 ms, and 4 m/s^2 over 1 ms).
//
// SI; rotary axes in rad. Any thread; errors: none.
#pragma once

#include <span>

#include "twin/sample.h"

namespace servotwin {

struct MotionRange {
  static constexpr double kSpan_s = 0.01;

  double speed = kAbsent;         ///< largest [m/s | rad/s]; NaN: not known
  double acceleration = kAbsent;  ///< largest [m/s^2 | rad/s^2]
};

/// Of the commands; NaN where no segment is longer than two spans.
[[nodiscard]] MotionRange motion_range(std::span<const Segment> segments);

}  // namespace servotwin
