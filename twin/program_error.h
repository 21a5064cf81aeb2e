// The contour error over a whole program, with where on the path it is and which way it points.
//
//   away = P - C,   C the point of the commanded path that is nearest to P
//
// As twin/contour.h says for one cycle: straight lines between the commands, a window of
// pi |P - command| along the path both ways, positive on the right in the plane; but the whole path
// is known, nothing is forgotten, and before its first and behind its last command it goes nowhere.
//
// Rotary axes have no distance. What they do to the tool is turn it: their error is taken against
// their command at the same place of the path, not at the same time, so that lag along the path is
// none. The root of the sum of its squares bounds the angle of the tool from above, with equality
// where one axis turns about a line across the tool.
//
// Linear axes [m], rotary axes [rad]. Errors: std::invalid_argument for axes that are not of one
// length, none, or more than kMaxPathAxes linear ones. Any thread.
#pragma once

#include <Eigen/Core>
#include <span>
#include <vector>

#include "twin/contour.h"

namespace servotwin {

struct ProgramError {
  std::vector<PathPoint> away;   ///< of the linear axes, in their order
  std::vector<PathPoint> along;  ///< direction of travel there, of length 1; 0 where there is none
  Eigen::ArrayXd distance;       ///< |away|, with the sign of the plane [m]
  Eigen::ArrayXd place;          ///< sample of the command that is nearest, with its fraction
  Eigen::ArrayXd turned;         ///< of the rotary axes [rad]; empty where there are none
};

/// `command`, `actual`: one array per axis; `rotary`, `rotary_actual` may be empty.
[[nodiscard]] ProgramError program_error(std::span<const Eigen::ArrayXd> command,
                                         std::span<const Eigen::ArrayXd> actual,
                                         std::span<const Eigen::ArrayXd> rotary = {},
                                         std::span<const Eigen::ArrayXd> rotary_actual = {});

}  // namespace servotwin
