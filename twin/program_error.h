// The contour error over a whole program, with its place on the path and its direction.
//
//   away = P - C,   C the point of the commanded path that is nearest to P
//
// As in twin/contour.h for one cycle: a polygon through the commands, a window of pi |P - command|
// along the path in both directions, positive to the right in the plane. Here the whole path is
// known and nothing is forgotten; the path does not continue before its first or behind its last
// command.
//
// Rotary axes have no distance; they turn the tool. Their error is taken against their command at
// the same place of the path, not at the same time, so lag along the path does not count. The root
// of the sum of its squares is an upper bound of the angular error of the tool, and equal to it if
// one axis turns about a line across the tool.
//
// Linear axes [m], rotary axes [rad]. Errors: std::invalid_argument if axes differ in length, if
// there is none, or if there are more than kMaxPathAxes linear ones. Allocates. Any thread. Source:
// docs/theory.md 12.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "twin/contour.h"

namespace servotwin {

struct ProgramError {
  std::vector<PathPoint> away;  ///< of the linear axes, in their order [m]
  std::vector<PathPoint>
      along;                ///< unit vector of the direction of travel there; 0 if there is none
  Eigen::ArrayXd distance;  ///< |away|, with the sign of the plane [m]
  Eigen::ArrayXd place;     ///< sample of the nearest command, with fraction
  Eigen::ArrayXd turned;    ///< angular error [rad]; empty without rotary axes
};

/// `command`, `actual`: one array per axis; `rotary`, `rotary_actual` may be empty.
[[nodiscard]] ProgramError program_error(std::span<const Eigen::ArrayXd> command,
                                         std::span<const Eigen::ArrayXd> actual,
                                         std::span<const Eigen::ArrayXd> rotary = {},
                                         std::span<const Eigen::ArrayXd> rotary_actual = {});

}  // namespace servotwin
