// Play, seen by the force: after a reversal it passes through a plateau near zero over a travel of
// the gap's width, then rises steeply.
//
// Friction alone cannot do that: after a reversal its force changes steeply first and less and less
// steeply with the travel (Masing's rule), so that behind zero it rises no steeper than at zero.
// Of every reversal: G the force along the new direction, s the travel since,
//
//   zero    s at which G passes -kNear of what it came from .. +kNear of where it goes to
//   ratio   slope of G behind that band / slope in it:  > 1 with play, <= 1 with friction alone
//   width   travel in the band, less what the slopes beside it would take
//
// A width of the machine is the same at all speeds; a lag of the record is the same in time.
// Units: m or rad, s, any unit of force. Any thread.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "twin/effect.h"

namespace servotwin {

struct Reversal {
  double time_s = 0.0;
  bool forward = true;   ///< into the positive direction
  double width = 0.0;    ///< [m | rad]
  double ratio = 1.0;    ///< of slopes
  double passing = 0.0;  ///< time in the band [s]
};

struct Plateau {
  std::vector<Reversal> reversals;       ///< that go through zero force and on
  double forward = 0.0, backward = 0.0;  ///< width in each direction, a median
  double width = 0.0;                    ///< mean of both
  double deviation = 0.0;                ///< robust, of the widths of one direction
  double statistic = 0.0;  ///< z of the logarithm of the ratios being above that of kSteeper
  bool by_travel =
      false;  ///< the width varies less in travel than in time, or speeds do not differ

  /// More than chance, of one width, and more than a corner that is not sharp.
  [[nodiscard]] bool found() const;
};

/// One unbroken stretch of evenly sampled position and force.
struct PositionForce {
  double start_s = 0.0, step_s = 0.0;
  Eigen::ArrayXd position, force;
};
[[nodiscard]] Plateau plateau_of(const std::vector<PositionForce>& stretches);

/// The force of a body that is moved through play and a spring by a motion of `position`, per level
/// of its friction: 0 within the gap, then rising over `give` to 1, where the body slides. `start`:
/// -1 .. 1, how far it is pressed to one side before the motion begins.
[[nodiscard]] Eigen::ArrayXd force_through_gap(const Eigen::ArrayXd& position, double width,
                                               double give, double start);

}  // namespace servotwin
