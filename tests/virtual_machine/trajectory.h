// Commanded motion of one axis: jerk-limited moves, arcs and dwells, in closed form at every time.
//
// Every move runs a path length s(t) of piecewise constant jerk, at rest at both ends:
//
//   s''' in {+j, 0, -j, 0, -j, 0, +j}    seven phases, |s'| <= V, |s''| <= A
//
// and lays it on the axis as the projection of a line, x = x0 + s D_x / D, or of an arc,
// x = x0 + R (cos(a + s/R) - cos(a)). Axes that project the same path keep step exactly.
// If the stroke D is too short for V, the peak velocity is
//
//   v = (-A^2/j + sqrt(A^4/j^2 + 4 A D)) / 2   if that is >= A^2/j,   else   (D sqrt(j) / 2)^(2/3).
//
// Units: any coherent set; the virtual machine uses m and s, the thesis study mm and s.
// Errors: std::invalid_argument for limits, times and radii that are not positive. Any thread.
#pragma once

#include <vector>

namespace servotwin::virtual_machine {

struct Limits {
  double velocity = 0.0;
  double acceleration = 0.0;
  double jerk = 0.0;
};

struct Setpoint {
  double position = 0.0;
  double velocity = 0.0;
  double acceleration = 0.0;
  double jerk = 0.0;
};

class Trajectory {
 public:
  explicit Trajectory(double start_position = 0.0);

  void dwell(double seconds);
  /// A straight move of this axis alone, from the present end to `target`.
  void move_to(double target, const Limits& limits);
  /// This axis' part of a straight move of several axes: it travels `displacement` while the path
  /// runs `length` >= |displacement|. The limits are those of the path.
  void line(double displacement, double length, const Limits& limits);
  /// The projection of an arc that starts at `start_angle` [rad] and sweeps `sweep` [rad]
  /// (negative: clockwise). X of a circle takes the angle, Y the angle - pi/2. The limits are those
  /// of the path.
  void arc(double radius, double start_angle, double sweep, const Limits& limits);

  /// Time of the end, when the axis rests at end_position().
  [[nodiscard]] double duration() const { return duration_; }
  [[nodiscard]] double end_position() const { return end_position_; }
  /// Before 0 the start, after duration() the end, both at rest. At a jump of the jerk: the later
  /// value.
  [[nodiscard]] Setpoint at(double time) const;

 private:
  /// One phase: s and its derivatives at `start`, and how s is laid on the axis.
  struct Phase {
    double start = 0.0;
    double s = 0.0, velocity = 0.0, acceleration = 0.0, jerk = 0.0;
    double origin = 0.0;     ///< line: position of s = 0; arc: its centre
    double direction = 0.0;  ///< line: dx/ds; arc: sense of rotation
    double radius = 0.0;     ///< 0: line
    double angle = 0.0;      ///< arc: angle of s = 0
  };
  void run(double stroke, const Limits& limits, const Phase& shape, double end_position);

  double start_position_ = 0.0;
  double end_position_ = 0.0;
  double duration_ = 0.0;
  std::vector<Phase> phases_;
};

}  // namespace servotwin::virtual_machine
