// The models that a stated uncertainty allows.
//
//   z^T z <= deviations^2,   theta = theta_0 + S V Lambda^(-1/2) z,
//   1 + S G S / missed^2 = V Lambda V^T
//
// theta are the poles (real pole, natural frequency, damping), the coefficients of the tracking
// numerator and the delay; S their standard deviations. A model file states these one by one, as if
// each could be off alone, but poles and numerator are estimated together: off alone they would
// have missed the recording by far more than they did. So what was seen counts too: G is the mean
// square by which the tracking error of a motion changes with theta, `missed` what the model was
// seen to miss on motion it was not fitted to, and a change of theta that would show there as one
// deviation more is as unlikely as one deviation of S. Without that the ellipsoid is that of S.
//
// Besides, the timing may be off by `timing_s` either way: what happens between the samples (held
// forces, velocities from differences, stamps) is in no model. T(0) stays 1.
//
// The models are the given one, the ends of the axes of the ellipsoid, and seeded draws from its
// surface, all with the timing early, right and late by turns: the same for the same input. Source:
// docs/theory.md 13.
//
// Any thread. Allocates.
#pragma once

#include <optional>
#include <vector>

#include "ilc/transfer.h"

namespace servotwin {

/// A motion by its spectrum, and what the model missed of a motion like it.
struct SeenOfModel {
  Eigen::ArrayXd omega;     ///< [rad/s]
  Eigen::ArrayXd weight;    ///< mean square of the velocity about each [m^2/s^2 | rad^2/s^2]
  double missed_rms = 0.0;  ///< [m | rad], > 0
};

/// Of a command whose samples are h [s] apart.
[[nodiscard]] SeenOfModel seen_of_model(const Eigen::ArrayXd& command, double h, double missed_rms);

/// Standard deviations; NaN counts as 0.
struct TransferUncertainty {
  PoleSet poles;                              ///< of the first label (labels_of)
  std::array<double, kMaxOrder> numerator{};  ///< c0..c(n-1)
  double delay_s = 0.0;
  double timing_s = 0.0;    ///< a bound, not a deviation
  double deviations = 2.0;  ///< how many of them a model may be off
  std::optional<SeenOfModel> seen;
};

/// The same share of every pole and coefficient, for models that do not state their own.
[[nodiscard]] TransferUncertainty relative_uncertainty(const Transfer& transfer, double share);

/// All of them stable.
[[nodiscard]] std::vector<Transfer> models_within(const Transfer& transfer,
                                                  const TransferUncertainty& uncertainty,
                                                  int draws = 200);

}  // namespace servotwin
