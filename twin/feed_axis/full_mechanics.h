// A ball screw stepped with all its unknowns: exact for torque and friction that hold over a cycle,
// on a grid of nut positions, linear between them (docs/theory.md 16.3). What the reduced one
// (reduced_mechanics.h) is measured against.
//
// One thread; step() allocates nothing.
#pragma once

#include <vector>

#include "twin/feed_axis/ball_screw.h"

namespace servotwin {

/// Of motor and table, in the table's units [m, m/s].
struct MechanicsState {
  double motor_position = 0.0, motor_velocity = 0.0, table_position = 0.0, table_velocity = 0.0;
};

/// Where the matrices are computed.
struct NutGrid {
  double from = 0.0, to = 0.0;  ///< from the bearing [m]
  double spacing = 0.0;         ///< at most [m]

  [[nodiscard]] int intervals() const;
  [[nodiscard]] double at(int i) const { return from + (to - from) * i / intervals(); }
};

/// Torque and friction held over a cycle, with the nut at one place: (q, q') <- phi (q, q') + gain
/// (torque, friction). Exact.
struct HeldMechanics {
  Eigen::MatrixXd phi;
  Eigen::MatrixX2d gain;
};
[[nodiscard]] HeldMechanics held(const BallScrew& screw, double nut, double step_s);

class FullMechanics {
 public:
  FullMechanics(const BallScrew& screw, const NutGrid& grid, double step_s);

  /// At rest, undeformed; where the nut is makes no difference.
  void reset(double nut);
  [[nodiscard]] const MechanicsState& state() const { return now_; }
  /// Torque [Nm] and friction on the table [N] over one cycle that begins with the nut here [m].
  void step(double torque, double friction, double nut) noexcept;

 private:
  BallScrew screw_;
  NutGrid grid_;
  std::vector<HeldMechanics> places_;
  Eigen::VectorXd q_, left_, right_;
  MechanicsState now_;
};

}  // namespace servotwin
