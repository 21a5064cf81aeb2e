// The rigid body with friction in a measured torque: T = m a + F_c sat(v / v_l) + B v, none of
// them negative; and which way the torque counts. Units as of torque.h. Any thread.
#pragma once

#include <Eigen/Core>

#include "diagnosis/blocked_regression.h"
#include "diagnosis/torque_rows.h"

namespace servotwin {

struct TorqueBody {
  double mass = 0.0, coulomb = 0.0, viscous = 0.0;
  double velocity_limit = 1e-3;  ///< v_l
  Eigen::MatrixXd columns;       ///< of those that are not 0, in this order, over all rows
  bool opposite = false;         ///< the record counts the torque against the position
  bool both_ways = false;        ///< the motion has both directions
  bool one_speed = false;        ///< its position is a straight line over time

  /// The column of the Coulomb friction, of the viscous friction; -1: there is none.
  [[nodiscard]] Eigen::Index coulomb_column() const;
  [[nodiscard]] Eigen::Index viscous_column() const;
};

/// From the training rows; turns the torque of the rows where it counts against the position.
/// Throws std::runtime_error where neither mass nor friction has a part in the torque.
[[nodiscard]] TorqueBody body_of(TorqueRows& rows);

[[nodiscard]] BlockedRegression training_of(const TorqueRows& rows);
void append(Eigen::MatrixXd& to, const Eigen::MatrixXd& columns);

}  // namespace servotwin
