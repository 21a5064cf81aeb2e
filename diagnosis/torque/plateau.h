// Detects backlash in the force: after a reversal the force has a plateau near zero over a travel
// of the width of the gap, then rises steeply.
//
// Friction alone has no such plateau: after a reversal its force changes steeply at first and less
// and less with the travel (Masing's rule), so that its slope beyond zero is not above that at
// zero. For every reversal, with G the force in the new direction and s the travel since:
//
//   band    s from G = -0.1 of the level before to G = +0.1 of the level after the reversal
//   ratio   slope of G after the band / slope in it:  > 1 with backlash, <= 1 with friction alone
//   width   travel in the band, minus the travel that the slopes on both sides would need for it
//
// The width of a gap is the same at all speeds; the delay of a record is the same in time.
// Units: m or rad, s, any unit of force. Any thread.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "twin/effect.h"

namespace servotwin {

/// One reversal and the plateau after it.
struct Reversal {
  double time_s = 0.0;
  bool forward = true;   ///< to the positive direction
  double width = 0.0;    ///< [m | rad]
  double ratio = 1.0;    ///< of slopes
  double passing = 0.0;  ///< time in the band [s]
};

/// The plateaus of all reversals together. Widths in m | rad.
struct Plateau {
  std::vector<Reversal> reversals;       ///< where the force changes its sign completely
  double forward = 0.0, backward = 0.0;  ///< median width in each direction
  double width = 0.0;                    ///< mean of both
  double deviation = 0.0;                ///< robust, of the widths within one direction
  double statistic = 0.0;                ///< z of the mean logarithm of ratio / 1.25 being above 0
  bool by_travel =
      false;  ///< the width varies less in travel than in time, or the speeds are all equal

  /// Whether there is backlash: significant, of a consistent width, and not just a rounded corner.
  [[nodiscard]] bool found() const;
};

/// One unbroken stretch of evenly sampled position and force.
struct PositionForce {
  double start_s = 0.0, step_s = 0.0;
  Eigen::ArrayXd position, force;
};
/// The plateaus after the reversals of these stretches.
[[nodiscard]] Plateau plateau_of(const std::vector<PositionForce>& stretches);

/// The force on a body that `position` drives through a gap and a spring, divided by its friction
/// level: 0 within the gap, then rising over the travel `give` to 1, where the body slides.
/// `start`: -1..1, the initial state from fully pressed to one side to fully pressed to the other.
[[nodiscard]] Eigen::ArrayXd force_through_gap(const Eigen::ArrayXd& position, double width,
                                               double give, double start);

}  // namespace servotwin
