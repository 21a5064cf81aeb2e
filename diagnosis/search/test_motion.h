// A test motion of an axis: moves and rests within the limits of its recorded motion, as samples of
// the position command and as G-code.
//
// Every leg has a trapezoidal velocity profile; the path is then smoothed by a moving average over
// `smoothing_s`:
//
//   x(t) = 1/T int_(t-T)^t x_trapezoid,   T = smoothing_s
//
// A mean of shifted copies of a path exceeds neither its positions, nor its speed, nor its
// acceleration A, and its jerk is at most 2 A / T. The motion starts and ends at rest.
//
// SI units; G-code in mm or degrees, feed per minute, dwell in seconds. Any thread.
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

/// The range and the peaks of the motion in a recording. The peaks are robust against a noisy
/// command (identification/recording/evidence.h).
struct SeenMotion {
  double start = 0.0;            ///< position at the end of the recording [m | rad]
  double low = 0.0, high = 0.0;  ///< of the command [m | rad]
  double velocity = 0.0;         ///< peak [m/s | rad/s]
  double acceleration = 0.0;     ///< peak [m/s^2 | rad/s^2]
  double jerk = 0.0;             ///< peak [m/s^3 | rad/s^3]
  double sample_time_s = 0.0;
};
/// The motion of these segments; zeros where they contain none.
[[nodiscard]] SeenMotion seen_motion(const std::vector<Segment>& segments);

/// One move of the test, and the rest after it.
struct TestLeg {
  double to = 0.0;            ///< end position [m | rad]
  double velocity = 0.0;      ///< limit [m/s | rad/s], > 0
  double acceleration = 0.0;  ///< [m/s^2 | rad/s^2], > 0
  double rest_s = 0.0;        ///< rest after the move [s]
  /// Description of the part of the test that begins with this leg; empty: the part continues.
  std::string shows = {};
};

struct TestMotion {
  double start = 0.0;        ///< [m | rad]
  double smoothing_s = 0.0;  ///< length of the moving average [s]
  std::vector<TestLeg> legs;
  /// The recording hardly accelerates; this motion reaches its speed sooner.
  bool accelerates_more = false;

  [[nodiscard]] double duration_s() const;
  [[nodiscard]] double end() const { return legs.empty() ? start : legs.back().to; }
  /// The position command [m | rad] with sampling time h [s], from rest at the start to rest at the
  /// end.
  [[nodiscard]] Eigen::ArrayXd command(double h) const;
};

/// The same motion as a G-code program, with the required axis accelerations as comments.
[[nodiscard]] std::string gcode(const TestMotion& motion, const std::string& axis, bool rotary);

}  // namespace servotwin
