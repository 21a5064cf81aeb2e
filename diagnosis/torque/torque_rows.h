// The rows of ForceData in which the axis moves, divided into training data and hold-out, with the
// regressors of the rigid body and of the effects of the catalogue in these rows.
//
// Units as in force_data.h. One thread.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "diagnosis/torque/plateau.h"
#include "identification/recording/segments.h"
#include "identification/torque/force_data.h"
#include "twin/catalogue.h"

namespace servotwin {

/// One effect with these shape parameters. Backlash is not a force of the catalogue: its kind is
/// kEffectKinds, its shape parameters are width, give and start (plateau.h).
struct TorqueTerm {
  std::size_t kind = kEffectKinds;
  std::vector<double> shapes;
  Eigen::Index first = 0;  ///< number of its columns to use, from the first; 0: all
  [[nodiscard]] static TorqueTerm gap(double width, double give, double start) {
    return {kEffectKinds, {width, give, start}, 0};
  }
};

/// The torque of the moving rows and the regressors that it is fitted by.
class TorqueRows {
 public:
  /// Throws std::runtime_error where too little of the motion has a torque. `commanded`: the
  /// segments have a true position command. `bandwidth_hz`: up to which torque and motion are
  /// compared (torque_band.h).
  TorqueRows(const SegmentedAxis& axis, double training_share, bool commanded, double bandwidth_hz);

  [[nodiscard]] const Eigen::VectorXd& torque() const { return torque_; }
  [[nodiscard]] const Eigen::VectorXd& time() const { return time_; }
  [[nodiscard]] const Eigen::VectorXd& velocity() const { return velocity_; }
  [[nodiscard]] const Eigen::VectorXd& position() const { return position_; }
  [[nodiscard]] double travel() const { return travel_; }
  [[nodiscard]] double step_s() const { return data_.step_s(); }
  [[nodiscard]] double training_to_s() const { return training_to_s_; }
  void turn_torque();  ///< changes the sign of the torque
  /// Sets the velocity above which the friction in the motion has its full value.
  void friction_from(double velocity_limit);

  /// The regressors of the rigid body: acceleration, saturated sign of the velocity, velocity.
  [[nodiscard]] Eigen::MatrixXd body(double velocity_limit) const;
  /// The regressors of an effect.
  [[nodiscard]] Eigen::MatrixXd columns(const TorqueTerm& term) const;
  /// Sine and cosine of this period in position, or of this frequency in time, computed without the
  /// filters. 0 where the filters would remove them; 0 everywhere if that is most of the motion.
  [[nodiscard]] Eigen::MatrixXd rough_waves(std::size_t kind, double first_shape) const;
  /// The grid of shape parameters at which this kind is tried; it varies mainly the first
  /// parameter.
  [[nodiscard]] std::vector<std::vector<double>> grid(std::size_t kind,
                                                      double velocity_limit) const;

  /// The rows of the training data, and those of the hold-out.
  template <class Rows>
  [[nodiscard]] Rows training(const Rows& all) const {
    return all(training_, Eigen::all);
  }
  template <class Rows>
  [[nodiscard]] Rows holdout(const Rows& all) const {
    return all(holdout_, Eigen::all);
  }

  /// Position, and torque minus mass times acceleration, of all rows.
  [[nodiscard]] std::vector<PositionForce> stretches(double mass) const;
  /// Amplitudes of the tracking error [m | rad] at these periods in position; NaN where there is no
  /// command.
  [[nodiscard]] std::vector<double> tracking_error_at(const std::vector<double>& periods) const;

 private:
  [[nodiscard]] Eigen::VectorXd under_way(const Eigen::VectorXd& all) const { return all(used_); }
  /// A value of every sample, filtered as the torque is, in the rows in which the axis moves.
  template <class Value>
  [[nodiscard]] Eigen::VectorXd compared(const Value& value) const;

  ForceData data_;
  std::vector<std::vector<Motion>> motion_;  // of every stretch
  double bandwidth_hz_ = 0.0, sign_ = 1.0;
  bool rotary_ = false;
  std::vector<Eigen::Index> used_;                // of the rows of the data
  std::vector<Eigen::Index> training_, holdout_;  // of those
  Eigen::VectorXd torque_, time_, velocity_, position_, acceleration_, tracking_error_;
  double travel_ = 0.0, training_to_s_ = 0.0, begin_s_ = 0.0;
};

}  // namespace servotwin
