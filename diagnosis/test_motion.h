// A motion that an axis is asked to make as a test: moves and rests within what it has been seen to
// do, as samples of its command and as G-code.
//
// Every leg is a trapezoid of velocity; the whole path is then averaged over `smoothing_s`:
//
//   x(t) = 1/T int_(t-T)^t x_trapezoid,   T = smoothing_s
//
// A mean of shifted copies exceeds neither their place, nor their speed, nor their acceleration,
// and its jerk is at most 2 A / T. Starts and ends at rest.
//
// SI units; G-code in mm or degrees, feed per minute, dwell in seconds. Any thread.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

/// What an axis did in a recording. Peaks are those of identification/recording/evidence.h, which a
/// noisy command does not raise.
struct SeenMotion {
  double start = 0.0;            ///< where it stood at the end [m | rad]
  double low = 0.0, high = 0.0;  ///< of the command [m | rad]
  double velocity = 0.0;         ///< [m/s | rad/s]
  double acceleration = 0.0;     ///< [m/s^2 | rad/s^2]
  double jerk = 0.0;             ///< [m/s^3 | rad/s^3]
  double sample_time_s = 0.0;
};
/// Zeros where the segments hold no motion.
[[nodiscard]] SeenMotion seen_motion(const std::vector<Segment>& segments);

struct TestLeg {
  double to = 0.0;            ///< [m | rad]
  double velocity = 0.0;      ///< > 0
  double acceleration = 0.0;  ///< > 0
  double rest_s = 0.0;        ///< after it
  std::string shows = {};     ///< what begins with this leg, for people; empty: goes on
};

struct TestMotion {
  double start = 0.0;
  double smoothing_s = 0.0;
  std::vector<TestLeg> legs;

  [[nodiscard]] double duration_s() const;
  [[nodiscard]] double end() const { return legs.empty() ? start : legs.back().to; }
  /// The command every h seconds, from rest at the start to rest at the end.
  [[nodiscard]] Eigen::ArrayXd command(double h) const;
};

/// The same as a program for a control, with its limits in comments.
[[nodiscard]] std::string gcode(const TestMotion& motion, const std::string& axis, bool rotary);

}  // namespace servotwin
