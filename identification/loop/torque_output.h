// The motor's torque beside the position in the identification of an axis: what it is of the
// simulated force and velocity, how well a model predicts it, and the model that is fitted to both.
// The training data decide; the held-out data judge.
//
// Any thread.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "identification/loop/output_error.h"
#include "identification/model/motor_torque.h"
#include "identification/recording/noise_floor.h"
#include "identification/recording/segments.h"

namespace servotwin {

/// The recorded torque of an axis.
struct TorqueData {
  std::string unit;
  double at_limit_share = 0.0;               ///< as of MotorTorque; NaN in those rows
  std::vector<Segment> training, judged_on;  ///< the latter with lead-in
};
/// Parts as those of `split` (identify.h). Segments without a torque where it does not change.
[[nodiscard]] TorqueData torque_data(const SegmentedAxis& axis, double share, bool split_each);

/// The torque as an output of the model, by the training data. Nothing where too little of it is
/// recorded, or where too much of it is left on held-out data: it is not that of this motion.
struct TorqueOutput {
  std::optional<MotorTorque> torque;
  std::string why_not;  ///< "it does not change", where there is none
};
[[nodiscard]] TorqueOutput motor_torque(const Model& model, const TorqueData& data);

/// The model that position and torque of the training data together fit best, of the structure of
/// one that was fitted to the position alone. Nothing where the two contradict each other, where
/// too much of the torque is left, and for a loop with modes, whose force is not known.
[[nodiscard]] std::optional<OutputErrorFit> fitted_with_torque(const Model& model,
                                                               const TorqueData& data,
                                                               const NoiseFloor& floor);

/// The lag with which the simulated torque is nearest to the recorded one: a delay of -10 to 20 ms
/// or a filter of up to 20 ms; 0 where the motion does not show it.
[[nodiscard]] TorqueLag lag_of_torque(const Model& model, const std::vector<Segment>& segments);

/// Recorded minus simulated torque, and the recorded one about its mean, over the samples that
/// count: two RMS values; NaN where no sample has a torque.
struct TorqueError {
  double rms = kAbsent, scatter = kAbsent;
  /// What is left, as a share of the scatter; NaN where the torque does not change.
  [[nodiscard]] double share() const { return scatter > 0.0 ? rms / scatter : kAbsent; }
};
[[nodiscard]] TorqueError torque_error(const Model& model, const TorqueScale& by,
                                       const TorqueLag& lag, const std::vector<Segment>& segments);

}  // namespace servotwin
