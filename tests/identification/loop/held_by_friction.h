// An axis that friction holds away from its command, and a recording of it that rests in between.
#pragma once

#include <Eigen/Core>

#include "tests/hidden_effects/rig.h"
#include "twin/sample.h"

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

struct RestBetweenMoves {
  Segment segment;
  double rest_begins_s = 0.0, rest_s = 1.2;
};

/// Moves of 5.4 s, a rest, and moves again until `ends_s`.
inline RestBetweenMoves rest_between_moves(const hidden_effects::Rig& rig, double ends_s = 10.0) {
  constexpr double kRestBegins_s = 5.4;
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
  RestBetweenMoves out;
  move_until(kRestBegins_s);
  out.rest_begins_s = path.duration();
  path.dwell(out.rest_s);
  move_until(ends_s);
  const auto trace = hidden_effects::simulate(rig, path);
  const auto rows = static_cast<Eigen::Index>(trace.command.size());
  out.segment.sample_time_s = rig.reading.sample_time;
  out.segment.command = Eigen::Map<const Eigen::ArrayXd>(trace.command.data(), rows);
  out.segment.actual = Eigen::Map<const Eigen::ArrayXd>(trace.actual.data(), rows);
  return out;
}

}  // namespace servotwin
