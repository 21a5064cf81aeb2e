// The signals of one segment that identification uses: error, measured velocity, and others that
// are computed once per data set.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "twin/hold.h"
#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

struct Signals {
  double h = 0.0;           ///< [s]
  Spline command;           ///< x_r
  Eigen::ArrayXd error;     ///< x_r - x
  Eigen::ArrayXd position;  ///< x
  Eigen::ArrayXd
      velocity;  ///< measured: central difference, then a centred mean (docs/theory.md 1.4)
  Eigen::ArrayXd acceleration;  ///< x'', a central difference of the velocity; empty: not requested

  double start_s = 0.0;  ///< in the recording
  /// Of the loop, for effects on the reading alone; empty: the reading.
  Eigen::ArrayXd loop_position;
  Eigen::ArrayXd in_cut;  ///< as of the segment
  /// As of a Motion; empty: no other axis is known.
  Eigen::ArrayXd neighbour_acceleration, neighbour_motion_acceleration;
  /// As of a Motion; empty: no drive is known.
  Eigen::ArrayXd demand, demand_rate, demand_damping, friction;

  Eigen::Index lead = 0;      ///< as of the segment
  double length_scale = 1.0;  ///< as of the segment

  [[nodiscard]] Eigen::Index size() const { return error.size(); }
};

/// The velocity is the mean of at most 11 samples, over no more than kVelocityMean_s.
[[nodiscard]] Signals signals_of(const Segment& segment);
/// Longest mean [s]: a longer one distorts the velocity at reversals.
inline constexpr double kVelocityMean_s = 0.011;
/// The same with every `every`-th sample: for a coarse search. The velocity is taken before.
[[nodiscard]] Signals decimated(const Signals& signals, int every);

/// Position, velocity and acceleration become those of a motion without noise: a simulated one.
void set_motion(Signals& signals, Eigen::ArrayXd position);

/// Adds the force that the control of this model's loop demands along the motion of the signals
/// (docs/theory.md 3.11; Twin::demand is the same along the simulated motion), and the force of its
/// friction law there.
void add_drive(const Model& model, Signals& signals);

/// Central difference (ends 0), then a centred mean of 2 m + 1 samples that shrinks at the ends.
[[nodiscard]] Eigen::ArrayXd measured_velocity(const Eigen::ArrayXd& position, double h,
                                               int half_window);

}  // namespace servotwin
