// What was recorded of an axis against what a model simulates of it, for fits in free simulation
// (output_error.h): the encoder in the loop; on an axis of two masses also that of the motor; and
// the motor's torque, each with its own deviation.
//
// Some things about them are no parameters of the model and always free: the difference of the two
// encoders' zeros, and scale, viscous part and offset of the torque (motor_torque.h). A recorded
// reading may be lost.
//
// Lengths in m or rad, the torque in its recorded unit. Any thread.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "identification/loop/coordinates.h"
#include "identification/loop/reading_likelihood.h"
#include "identification/model/motor_torque.h"
#include "twin/model.h"
#include "twin/sample.h"
#include "twin/twin.h"

namespace servotwin {

/// What is missed, with its derivatives by the coordinates; 0 by those that are not free.
struct Missed {
  Eigen::VectorXd r;  ///< empty if the model is not valid
  Eigen::MatrixXd by;
  TorqueScale torque;  ///< absent without one
};

/// What was recorded of some segments: one row per sample that counts (those that determine the
/// starting state do not) and output, in turns. The segments outlive it.
class Readings {
 public:
  /// All that every segment has and this model simulates; the torque only if it is asked for, by
  /// its lag.
  Readings(const std::vector<Segment>& segments, const Model& start,
           const std::optional<TorqueLag>& torque = {});
  /// The same outputs as others.
  Readings(const std::vector<Segment>& segments, const Model& start, Outputs outputs,
           const TorqueLag& lag = {});

  [[nodiscard]] Outputs outputs() const { return outputs_; }
  [[nodiscard]] Eigen::Index per_sample() const { return recorded_.cols(); }
  [[nodiscard]] Eigen::Index rows() const { return recorded_.size(); }
  [[nodiscard]] double row_s() const {
    return segments_->front().sample_time_s / static_cast<double>(per_sample());
  }
  /// Place of the torque among the outputs; -1 without one.
  [[nodiscard]] Eigen::Index torque_column() const {
    return outputs_.torque ? per_sample() - 1 : -1;
  }
  /// 0 without a torque.
  [[nodiscard]] double torque_rms() const;
  [[nodiscard]] bool known(Eigen::Index row) const {
    const Eigen::Index output = row % per_sample();
    return output == 0 || std::isfinite(recorded_(row / per_sample(), output));
  }
  /// Those of one output that are known.
  [[nodiscard]] Eigen::VectorXd of(Eigen::Index output, const Eigen::VectorXd& r) const;

  /// Recorded minus simulated; `by` stays empty.
  [[nodiscard]] Missed missed(const Model& model) const;
  [[nodiscard]] Missed missed(const Coordinates& coordinates, const double* x,
                              const std::vector<std::size_t>& free) const;

 private:
  /// Puts the lag into the torque of one simulated segment, or of a derivative of it.
  void lag(const Segment& segment, Eigen::Ref<Eigen::VectorXd> simulated) const;
  /// From what `simulate` gave of all samples that count, outputs in turns; `by`: a column for
  /// every coordinate that is free.
  [[nodiscard]] Missed left(const Eigen::VectorXd& simulated, const Eigen::MatrixXd& by,
                            const std::vector<std::size_t>& free, Eigen::Index coordinates) const;

  const std::vector<Segment>* segments_;
  Outputs outputs_;
  TorqueLag lag_;
  std::vector<Eigen::Index> first_{0};  // sample of every segment
  Eigen::MatrixXd recorded_;            // one row per sample, one column per output
};

/// The likelihood of every output's readings.
class Likelihoods {
 public:
  /// With the deviations under which these are most probable. Of all but the first output the step
  /// is part of the deviation.
  Likelihoods(const Readings& readings, const Eigen::VectorXd& r, double encoder_step);
  [[nodiscard]] double sigma(std::size_t output = 0) const { return sigmas_[output]; }
  [[nodiscard]] const ReadingLikelihood& of(Eigen::Index row) const {
    return of_output_[static_cast<std::size_t>(row) % of_output_.size()];
  }
  [[nodiscard]] double minus_log_likelihood(const Readings& readings,
                                            const Eigen::VectorXd& r) const;
  /// The residuals of least squares for these; `jacobian`, of r, becomes theirs.
  Eigen::VectorXd weighted(const Eigen::VectorXd& r, Eigen::MatrixXd& jacobian) const;

 private:
  std::vector<double> sigmas_;
  std::vector<ReadingLikelihood> of_output_;
};

}  // namespace servotwin
