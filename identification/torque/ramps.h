// Ramps of constant commanded velocity in a recording, and the mean torque on each (Giberti et al.
// 2019, 3.3).
//
// On a ramp there is no acceleration, so the motor's mean torque is friction (plus any constant
// load) at that velocity. A ramp is the longest run of commands on one straight line. The torque is
// averaged over the part of the ramp within a band about `centre`, or over its middle.
//
// Stick-slip: at low speed, where friction falls with speed, the axis alternates between rest and
// jumps. The mean torque of such a ramp is not friction at that velocity. A ramp is marked as
// stick-slip if the axis stands for part of the time and covers part of the travel at more than
// twice the mean velocity, over windows that are long compared to the encoder's step
// (docs/theory.md 9.2).
//
// Units: m or rad, s; torque in its recorded unit. Errors: none. Allocates. Any thread.
#pragma once

#include <optional>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

struct Ramp {
  double begin_s = 0.0, end_s = 0.0;  ///< averaged interval [s]
  double velocity = 0.0;              ///< measured mean, signed [m/s | rad/s]
  double torque = 0.0;                ///< mean
  double torque_deviation = 0.0;      ///< of that mean, with correlation in time
  double ripple = 0.0;                ///< standard deviation of the velocity / its mean
  bool judged = false;                ///< long enough to decide whether it has stick-slip
  bool stick_slip = false;
};

struct RampOptions {
  double centre = 0.0;         ///< centre of the band [m | rad]
  std::optional<double> band;  ///< its width [m | rad]; absent: the middle of every ramp
  double middle = 0.6;         ///< the middle, as a share of a ramp's time
  double shortest_s = 0.05;    ///< least averaged time [s]
  double least_travel = 2e-5;  ///< least length of a ramp [m | rad]
  /// Allowed distance of a command from the line [m | rad]; larger for a coarser command.
  double tolerance = 5e-7;
};

/// In order of time; empty if there are none.
[[nodiscard]] std::vector<Ramp> ramps_of(const std::vector<Segment>& segments,
                                         const RampOptions& options = {});

/// The highest speed of a ramp with stick-slip [m/s | rad/s]; 0 if there is none.
[[nodiscard]] double stick_slip_below(const std::vector<Ramp>& ramps);

}  // namespace servotwin
