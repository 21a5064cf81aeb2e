// Commanded motion of an axis: random mixes of typical production motions.
//
// SI units. Errors: std::invalid_argument for limits that are not positive. Any thread.
#pragma once

#include <vector>

#include "tests/hidden_effects/random.h"
#include "tests/virtual_machine/trajectory.h"

namespace servotwin::hidden_effects {

struct Motion {
  enum class Style { kProduction, kCircles, kMoves };
  Style style = Style::kProduction;
  double duration = 20.0;  ///< [s]; the last rest fills it up
  double start = 0.0;      ///< [m]
  double stroke = 0.15;    ///< moves end within +-stroke / 2 of the start [m]
  double longest_rest = 0.3;
  virtual_machine::Limits limits{.velocity = 0.25, .acceleration = 3.0, .jerk = 60.0};
};

/// Positioning, feed moves, pockets, full circles and rests in proportions given by the style, and
/// slow reversals of about 0.1 mm at least every five seconds.
[[nodiscard]] virtual_machine::Trajectory motion_of(const Motion& motion, Random& random);

struct Interval {
  double begin = 0.0, end = 0.0;  ///< [s]
};

/// The intervals of at least 20 ms in which the command rests, in order of time.
[[nodiscard]] std::vector<Interval> rests(const virtual_machine::Trajectory& command);

/// The intervals between the rests.
[[nodiscard]] std::vector<Interval> moves(const virtual_machine::Trajectory& command);

}  // namespace servotwin::hidden_effects
