// The rows on which torque is compared with motion: those of ForceData that are under way, split
// into training data and hold-out, and the columns of the body and of the catalogue on them.
//
// Units as of force_data.h. One thread.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "diagnosis/plateau.h"
#include "identification/recording/segments.h"
#include "identification/torque/force_data.h"
#include "twin/catalogue.h"

namespace servotwin {

/// One effect at these shapes. Play is none of the catalogue's forces: kind is kEffectKinds, the
/// shapes are width, give and start (plateau.h).
struct TorqueTerm {
  std::size_t kind = kEffectKinds;
  std::vector<double> shapes;
  Eigen::Index first = 0;  ///< of its columns; 0: all of them
  [[nodiscard]] static TorqueTerm gap(double width, double give, double start) {
    return {kEffectKinds, {width, give, start}, 0};
  }
};

class TorqueRows {
 public:
  /// Throws std::runtime_error where too little of the motion has a torque.
  TorqueRows(const SegmentedAxis& axis, double training_share, bool commanded);

  [[nodiscard]] const Eigen::VectorXd& torque() const { return torque_; }
  [[nodiscard]] const Eigen::VectorXd& time() const { return time_; }
  [[nodiscard]] const Eigen::VectorXd& velocity() const { return velocity_; }
  [[nodiscard]] const Eigen::VectorXd& position() const { return position_; }
  [[nodiscard]] double travel() const { return travel_; }
  [[nodiscard]] double step_s() const { return data_.step_s(); }
  [[nodiscard]] double training_to_s() const { return training_to_s_; }
  void turn_torque();  ///< the other sign from here on
  /// From here on the friction of the motion has its direction from this velocity on.
  void friction_from(double velocity_limit);

  /// Acceleration, saturated sign of the velocity, velocity.
  [[nodiscard]] Eigen::MatrixXd body(double velocity_limit) const;
  [[nodiscard]] Eigen::MatrixXd columns(const TorqueTerm& term) const;
  /// Sine and cosine of this period of position, or frequency of time, without the filters; 0 where
  /// they would leave nothing, everywhere if that is most of the motion.
  [[nodiscard]] Eigen::MatrixXd rough_waves(std::size_t kind, double first_shape) const;
  /// Points of the first shape at which this kind is looked for.
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

  /// Position, and the torque less that of the mass, at all times.
  [[nodiscard]] std::vector<PositionForce> stretches(double mass) const;
  /// Amplitudes of the tracking error at periods of position; nothing where there is no command.
  [[nodiscard]] std::vector<double> tracking_error_at(const std::vector<double>& periods) const;

 private:
  [[nodiscard]] Eigen::VectorXd under_way(const Eigen::VectorXd& all) const { return all(used_); }
  /// A value of every sample, as it is compared, of the rows that are under way.
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
