// Where the motor gives all it can: its torque stays at the highest level of the recording while
// the axis does not follow the acceleration of its command, or while the control asks for more.
//
// None of the three alone is a limit. A move at constant acceleration has a flat torque too, and
// there the axis follows; a short peak is not followed, and its torque is not flat. With M the
// level, b the width of the noise about it, and v the velocity over a piece of 10 ms at the level:
//
//   flat     samples above M - b / samples above M - 4 b (0.5 at the top of a parabola)
//
//   lacking  |change of v_r - change of v| / the larger one of both
//   beyond   (what the control asks, by the law of the samples elsewhere, - torque) / M
//
// For lacking, moments at constant speed do not count: there friction makes the torque flat.
//
// At its limit the loop is open: those moments say nothing about the loop (docs/theory.md 3.11).
// Units: the recorded unit of the torque, whatever its sign; s. Any thread.
#pragma once

#include <cstddef>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

struct TorqueLimit {
  struct Moment {
    double begin_s = 0.0, end_s = 0.0;
    double beyond = kAbsent;  ///< as above, in its second half
  };
  /// A part of a moment, long enough to have a velocity.
  struct Piece {
    std::size_t moment = 0;     ///< its place in `moments`
    double time_s = 0.0;        ///< of its middle
    double noise = 0.0;         ///< standard deviation of `lacking` by the encoder
    double lacking = 0.0;       ///< as above, 0..2
    double lacking_mps2 = 0.0;  ///< acceleration that the command has and the axis has not
    double acceleration = 0.0;  ///< the higher one of command and axis [m/s^2 | rad/s^2]
    double beside_level = 0.0;  ///< mean torque minus level, both without sign
  };
  double level = 0.0;              ///< M; 0 where there is no torque
  double flat = 0.0;               ///< 0..1
  double law_error = kAbsent;      ///< RMS error of the law at high torque elsewhere, over M
  double peak_acceleration = 0.0;  ///< of the command [m/s^2 | rad/s^2]
  std::vector<Moment> moments;     ///< in the order of time
  std::vector<Piece> pieces;       ///< long enough to have a velocity

  /// Whether the motor is at its limit in these moments.
  [[nodiscard]] bool found() const;
  [[nodiscard]] double duration_s() const;  ///< of all moments together
};

[[nodiscard]] TorqueLimit torque_limit(const std::vector<Segment>& segments);

/// The segments without these moments. What follows one begins with a lead-in, in which the loop
/// settles. Empty where less than half of the motion would be left.
[[nodiscard]] std::vector<Segment> away_from(const TorqueLimit& limit,
                                             const std::vector<Segment>& segments);

}  // namespace servotwin
