// Does this motion show what is to be identified? Answers by name, with the motion that would.
//
// Before a fit: travel, speed in both directions, reversals, acceleration. After it: a parameter
// whose standard deviation is a large part of its value was not excited, whatever the residual
// says.
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

/// What no fit could find in this motion: one line each, empty if nothing is missing.
[[nodiscard]] std::vector<std::string> missing_motion(const Excitation& excitation, bool rotary);

}  // namespace servotwin
