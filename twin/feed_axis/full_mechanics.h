// A ball screw stepped with all its unknowns: exact for torque and friction held over a cycle, on a
// grid of nut positions, linear between them (docs/theory.md 16.3). It is the reference for the
// reduced mechanics (reduced_mechanics.h).
//
// SI units. Errors: none. One thread; step() allocates nothing.
#pragma once

#include <vector>

#include "twin/feed_axis/ball_screw.h"

namespace servotwin {

/// Position and velocity of motor and table, in the units of the table [m, m/s].
struct MechanicsState {
  double motor_position = 0.0, motor_velocity = 0.0, table_position = 0.0, table_velocity = 0.0;
};

/// Positions of the nut at which the matrices are computed.
struct NutGrid {
  double from = 0.0, to = 0.0;  ///< range, from the bearing [m]
  double spacing = 0.0;         ///< largest spacing [m], > 0

  [[nodiscard]] int intervals() const;
  [[nodiscard]] double at(int i) const { return from + (to - from) * i / intervals(); }
};

/// One exact step with torque and friction held over a cycle and the nut at one position:
/// (q, q') <- phi (q, q') + gain (torque, friction).
struct HeldMechanics {
  Eigen::MatrixXd phi;
  Eigen::MatrixX2d gain;
};
[[nodiscard]] HeldMechanics held(const BallScrew& screw, double nut, double step_s);

class FullMechanics {
 public:
  FullMechanics(const BallScrew& screw, const NutGrid& grid, double step_s);

  /// At rest and undeformed; the state does not depend on the position of the nut.
  void reset(double nut);
  [[nodiscard]] const MechanicsState& state() const { return now_; }
  /// One cycle with this torque [Nm] and friction on the table [N], with the nut at `nut` [m] at
  /// its start.
  void step(double torque, double friction, double nut) noexcept;

 private:
  BallScrew screw_;
  NutGrid grid_;
  std::vector<HeldMechanics> places_;
  Eigen::VectorXd q_, left_, right_;
  MechanicsState now_;
};

}  // namespace servotwin
