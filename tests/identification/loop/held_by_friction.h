// An axis that friction holds away from its command, and a recording of it that rests in between.
#pragma once

#include <Eigen/Core>
#include <utility>

#include "identification/recording/segments.h"
#include "tests/hidden_effects/rig.h"

namespace servotwin {

/// An axis without integral action, which friction of 60 N holds up to 15 um from its command.
inline hidden_effects::Rig held_by_friction() {
  hidden_effects::Rig rig;
  rig.body.mass = 200.0;
  rig.drive.position_gain = 80.0;
  rig.drive.velocity_gain = 200.0 * 250.0;
  rig.friction.family = hidden_effects::Friction::Family::kMaxwell;
  rig.friction.level = 60.0;
  rig.friction.presliding_distance = 1.5e-5;
  rig.friction.viscous = 200.0;
  rig.reading.noise = 3e-8;
  return rig;
}

/// A recording with one segment: moves of 5.4 s, a rest of 1.2 s, and moves again until 10 s.
struct HeldAxis {
  SegmentedAxis axis;
  double in_rest_s = 0.0;  // within the rest
  [[nodiscard]] const Segment& segment() const { return axis.segments.front(); }
};

inline HeldAxis axis_held_by_friction() {
  constexpr double kRestBegins_s = 5.4, kRest_s = 1.2, kEnds_s = 10.0;
  constexpr virtual_machine::Limits kBrisk{.velocity = 0.2, .acceleration = 4.0, .jerk = 150.0};
  virtual_machine::Trajectory path(0.0);
  path.dwell(0.2);
  int moves = 0;
  const auto move_until = [&](double end_s) {
    for (; path.duration() < end_s; ++moves) {
      path.dwell(0.05 + 0.03 * (moves % 4));
      path.move_to((moves % 2 == 0 ? 0.02 : -0.015) * (1 + moves % 3), kBrisk);
    }
  };
  HeldAxis out;
  move_until(kRestBegins_s);
  out.in_rest_s = path.duration() + 0.3 * kRest_s;
  path.dwell(kRest_s);
  move_until(kEnds_s);
  const hidden_effects::Rig rig = held_by_friction();
  const auto trace = hidden_effects::simulate(rig, path);
  const auto rows = static_cast<Eigen::Index>(trace.command.size());
  Segment segment;
  segment.sample_time_s = rig.reading.sample_time;
  segment.command = Eigen::Map<const Eigen::ArrayXd>(trace.command.data(), rows);
  segment.actual = Eigen::Map<const Eigen::ArrayXd>(trace.actual.data(), rows);
  out.axis.axis = "X";
  out.axis.sample_time_s = segment.sample_time_s;
  out.axis.segments = {std::move(segment)};
  return out;
}

}  // namespace servotwin
