// The rigid body with friction in a measured torque, and the sign of the recorded torque:
//   T = m a + F_c sat(v / v_l) + B v + G cos(x - x_g),   m, F_c, B >= 0
// G is the gravity of a load that swings with a rotary axis, 0 where the torque shows none. Where
// the axis moves in one direction, Coulomb friction and a constant force are the same: then
//   T = m a + F + B v. Units as in torque.h. Any thread.
#pragma once

#include <Eigen/Core>

#include "diagnosis/statistics/blocked_regression.h"
#include "diagnosis/torque/torque_rows.h"

namespace servotwin {

/// z of a mass above which the motion shows it, and with it the sign of the torque.
inline constexpr double kMinMassEvidence = 4.0;

struct TorqueBody {
  double mass = 0.0, coulomb = 0.0, viscous = 0.0;
  double mass_z = 0.0;           ///< of the mass, by Student's t
  double constant = 0.0;         ///< F, of an axis that moves in one direction; of either sign
  double gravity = 0.0;          ///< G
  double gravity_at = 0.0;       ///< x_g [rad], where it is largest
  double velocity_limit = 1e-3;  ///< v_l
  Eigen::MatrixXd columns;       ///< regressors of those that are not 0, in this order, all rows
  bool opposite = false;         ///< the recorded torque has the opposite sign to the position
  bool both_ways = false;        ///< the axis moves in both directions, by way or by time
  bool held_out_turns = false;   ///< it does not, but moves in the other one in the hold-out
  bool one_speed = false;        ///< the axis moves at one constant speed throughout

  /// The column of the Coulomb friction and that of the viscous friction; -1: there is none.
  [[nodiscard]] Eigen::Index coulomb_column() const;
  [[nodiscard]] Eigen::Index viscous_column() const;
};

/// Fits the rigid body to the training rows. Changes the sign of the torque in `rows` where it is
/// opposite to the position. Throws std::runtime_error where neither mass nor friction contributes
/// to the torque.
[[nodiscard]] TorqueBody body_of(TorqueRows& rows, bool rotary);

/// The torque of the training rows as the left-hand side of a blocked regression.
[[nodiscard]] BlockedRegression training_of(const TorqueRows& rows);
/// Appends columns on the right.
void append(Eigen::MatrixXd& to, const Eigen::MatrixXd& columns);

}  // namespace servotwin
