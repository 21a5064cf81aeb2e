// A rig that makes quick moves of 10 to 80 mm with short rests, as a recorded axis. SI units.
#pragma once

#include "identification/recording/segments.h"
#include "tests/hidden_effects/rig.h"

namespace servotwin::hidden_effects {

/// What the rig records along this path; with an encoder at the load the motor's exact position as
/// well.
[[nodiscard]] inline SegmentedAxis recorded_along(const virtual_machine::Trajectory& path,
                                                  const Rig& rig) {
  const Trace trace = simulate(rig, path);
  Segment segment;
  segment.sample_time_s = rig.reading.sample_time;
  const auto rows = static_cast<Eigen::Index>(trace.command.size());
  segment.command = Eigen::Map<const Eigen::ArrayXd>(trace.command.data(), rows);
  segment.actual = Eigen::Map<const Eigen::ArrayXd>(trace.actual.data(), rows);
  if (rig.reading.recorded == Encoder::kLoad)
    segment.actual_motor = Eigen::Map<const Eigen::ArrayXd>(trace.motor.data(), rows);
  SegmentedAxis axis;
  axis.axis = "X";
  if (!trace.torque.empty()) {
    segment.torque = Eigen::Map<const Eigen::ArrayXd>(trace.torque.data(), rows);
    axis.torque_unit = rig.reading.torque_unit;
  }
  axis.sample_time_s = segment.sample_time_s;
  axis.segments.push_back(segment);
  return axis;
}

/// `rounds`: of one move there and one back.
[[nodiscard]] inline SegmentedAxis recorded_brisk_moves(const Rig& rig, int rounds) {
  constexpr virtual_machine::Limits kBrisk{.velocity = 0.2, .acceleration = 2.0, .jerk = 40.0};
  virtual_machine::Trajectory path(0.0);
  for (int i = 0; i < rounds; ++i) {
    path.dwell(0.3);
    path.move_to(0.02 * (1 + i % 3), kBrisk);
    path.dwell(0.2);
    path.move_to(-0.01 * (1 + i % 2), kBrisk);
  }
  path.dwell(0.3);
  return recorded_along(path, rig);
}

}  // namespace servotwin::hidden_effects
