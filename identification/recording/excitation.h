// Whether a motion excites the parameters that are to be identified; if not, which parameters and
// which motion would excite them.
//
// Before a fit: travel, speed in both directions, reversals, acceleration. After it: a parameter
// whose standard deviation is a large part of its value was not excited, however small the residual
// is.
#pragma once

#include <string>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

struct Excitation {
  double travel = 0.0;             ///< [m | rad]
  double peak_velocity = 0.0;      ///< commanded [m/s | rad/s]
  double peak_acceleration = 0.0;  ///< commanded, 99.5 % quantile
  int reversals = 0;               ///< of the commanded direction
  double forward_share = 0.0;      ///< of the time, commanded velocity above 2 % of its peak
  double backward_share = 0.0;
  double rest_share = 0.0;
};

[[nodiscard]] Excitation excitation_of(const std::vector<Segment>& segments);

/// The parameters that no fit can identify from this motion, one line each; empty if there are
/// none.
[[nodiscard]] std::vector<std::string> missing_motion(const Excitation& excitation, bool rotary);

}  // namespace servotwin
