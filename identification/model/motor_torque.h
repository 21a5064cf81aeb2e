// The torque of an axis' motor as a second output of its model:
//
//   T = scale f + viscous v + offset
//
// f: the motor's force per moved mass in free simulation, without the viscous friction that is part
// of the loop (Twin::motor_force). v: the velocity. The recorded torque may as well be a force, a
// current, a voltage or a per cent, of either sign. Nothing of it acts on the simulated motion.
//
// The recorded torque may be behind the simulated one: a drive filters the value that it shows, or
// sends it a cycle later.
//
// SI units, the torque in its recorded unit. Any thread.
#pragma once

#include <Eigen/Core>
#include <string>

#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

struct TorqueScale {
  double scale = kAbsent;    ///< torque per acceleration: the moved mass, where it is a force
  double viscous = kAbsent;  ///< torque per velocity
  double offset = kAbsent;
};

struct TorqueLag {
  double s = 0.0;       ///< negative: the position is behind
  bool filter = false;  ///< a filter of first order with this time constant, and not a delay
};

/// A torque as it is recorded with this lag.
[[nodiscard]] Eigen::ArrayXd lagged(const Eigen::ArrayXd& torque, const TorqueLag& lag,
                                    double sample_time_s);

struct MotorTorque {
  std::string unit;  ///< "N", "Nm", "A", "V" or "%"
  TorqueScale by;
  TorqueLag lag;
  /// Fitted to the same data as everything else, and not only to what the position says.
  bool fitted_together = false;
  /// Of the rows: there it stands at its lowest or highest value, at a limit of drive or recorder,
  /// and is left out of all fits and figures.
  double at_limit_share = 0.0;
  double training_rms = kAbsent;     ///< recorded minus simulated
  double holdout_rms = kAbsent;      ///< NaN where none was recorded in the held-out motion
  double holdout_scatter = kAbsent;  ///< RMS of the recorded torque about its mean
};

/// As it is recorded: one value per sample, in free simulation from command and starting state.
[[nodiscard]] Eigen::ArrayXd simulated_torque(const Model& model, const TorqueScale& by,
                                              const TorqueLag& lag, const Segment& segment);

}  // namespace servotwin
