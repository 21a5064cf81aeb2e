// Ramps of constant commanded velocity in a recording, and the mean torque on each (paper
// 001, 3.3).
//
// On a ramp there is no acceleration, so that the motor's mean torque is friction (and any constant
// load) at that velocity. A ramp is the longest run of commands that lie on one line. What is
// averaged is its part within a band about `centre`, or its middle.
//
// Stick-slip: at low speed and falling friction the axis does not move steadily, it waits and
// jumps. The mean torque of such a ramp is not friction at that velocity. It is recognised by
// standing for part of the time and covering part of the travel at more than twice the mean
// velocity, over windows that are long against the encoder's step.
//
// Units: m or rad, s; torque in its recorded unit. Any thread.
#pragma once

#include <optional>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

struct Ramp {
  double begin_s = 0.0, end_s = 0.0;  ///< of what is averaged
  double velocity = 0.0;              ///< mean, measured; with its direction
  double torque = 0.0;                ///< mean
  double torque_deviation = 0.0;      ///< of that mean; what hangs together in time counts once
  double ripple = 0.0;                ///< standard deviation of the velocity over its mean
  bool judged = false;                ///< long enough against the encoder's step to tell
  bool stick_slip = false;
};

struct RampOptions {
  double centre = 0.0;         ///< of the band [m | rad]
  std::optional<double> band;  ///< its width; without it the middle of every ramp
  double middle = 0.6;         ///< share of a ramp's time
  double shortest_s = 0.05;    ///< of what is averaged
  double least_travel = 2e-5;  ///< of a ramp [m | rad]
  /// Of the line through the commands, at least [m | rad]; more for a coarser command.
  double tolerance = 5e-7;
};

/// In the order of time; empty where there are none.
[[nodiscard]] std::vector<Ramp> ramps_of(const std::vector<Segment>& segments,
                                         const RampOptions& options = {});

/// The highest speed of a ramp with stick-slip; 0 if there is none.
[[nodiscard]] double stick_slip_below(const std::vector<Ramp>& ramps);

}  // namespace servotwin
