// Commanded motion of one axis whose velocity is a polygon: constant acceleration or none, pieced
// together without end.
//
//   x = x_i + v_i (t - t_i) + a_i (t - t_i)^2 / 2    from t_i on
//
// What friction is measured with; cutting motion is in trajectory.h. SI units. Errors:
// std::invalid_argument for times and accelerations that are not positive. Any thread.
#pragma once

#include <vector>

#include "tests/virtual_machine/axis.h"

namespace servotwin::virtual_machine {

class VelocityRamps {
 public:
  explicit VelocityRamps(double start_position = 0.0) { end_.position = start_position; }

  void accelerate_to(double velocity, double acceleration);
  /// Goes on at the present velocity.
  void hold(double seconds);

  [[nodiscard]] double duration() const { return duration_; }
  /// Where and how fast it is at the end of what has been pieced together.
  [[nodiscard]] const Setpoint& end() const { return end_; }
  /// Before 0 the start, from duration() on the end, both at rest. At a kink: the later
  /// acceleration.
  [[nodiscard]] Setpoint at(double time) const;
  [[nodiscard]] Command command() const;

 private:
  struct Piece {
    double start = 0.0;
    Setpoint setpoint;  ///< at `start`
  };
  void go_on(double seconds, double acceleration);

  std::vector<Piece> pieces_;
  Setpoint end_;
  double duration_ = 0.0;
};

}  // namespace servotwin::virtual_machine
