// Motion programs: what a machine does in production, as commands of its axes.
//
// `PlanePath` moves two axes along one path, both in step; `moves` is a seeded mix for one axis.
//
// SI units. Errors: std::invalid_argument for limits or lengths that are not positive. Any thread.
#pragma once

#include <cstdint>

#include "tests/virtual_machine/trajectory.h"

namespace servotwin::virtual_machine {

/// A path in the plane of two axes, built of moves from rest to rest.
class PlanePath {
 public:
  PlanePath(double x, double y) : x_(x), y_(y) {}

  void dwell(double seconds);
  void line_to(double x, double y, const Limits& limits);
  void line_by(double dx, double dy, const Limits& limits);
  /// An arc that leaves the present point at `start_angle` of its circle; a positive `sweep` turns
  /// from +X to +Y.
  void arc(double radius, double start_angle, double sweep, const Limits& limits);

  [[nodiscard]] const Trajectory& x() const { return x_; }
  [[nodiscard]] const Trajectory& y() const { return y_; }

 private:
  Trajectory x_;
  Trajectory y_;
};

struct MoveMix {
  double duration = 12.0;      ///< [s], reached by a last dwell
  double stroke = 0.1;         ///< targets lie within +-stroke/2 of the start [m]
  double slowest = 0.02;       ///< share of the full velocity of the slowest move
  double longest_dwell = 0.3;  ///< [s]
  Limits limits{0.25, 3.0, 60.0};
};

/// One axis: moves to random targets with velocities spread evenly in their logarithm, dwells, and
/// now and then a few slow reversals of a tenth of a millimetre to a millimetre.
[[nodiscard]] Trajectory moves(const MoveMix& mix, std::uint64_t seed);

/// `count` moves back and forth between the present position and one `amplitude` away.
void reverse(Trajectory& trajectory, double amplitude, int count, const Limits& limits);

}  // namespace servotwin::virtual_machine
