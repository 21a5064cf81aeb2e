// The velocity loop of a feed axis as a frequency response, as measured in stage 1 of Ferkl et al.
// 2021 (fig. 5; docs/theory.md 16.4). Linear: without friction, with the nut at one position.
//
//   closed(z) = L / (1 + L),   L(z) = control(z) P(z)
//
// P is the motor's velocity under a torque held over a cycle, computed from the sampled matrices as
// the control sees them. It is exactly the loop that FeedAxis simulates, not an approximation.
//
// Frequencies in Hz, below half of the control's rate. Errors: none. Allocates. Any thread.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "twin/feed_axis/ball_screw.h"

namespace servotwin {

/// The closed loop, from the commanded to the motor's velocity [1].
[[nodiscard]] Eigen::ArrayXcd closed_velocity_loop(const FeedAxisParts& parts, double nut,
                                                   const Eigen::ArrayXd& frequency_hz);

/// Figures of merit of the loop.
struct LoopFigures {
  double bandwidth_hz = 0.0;  ///< up to which the closed loop stays above -3 dB
  double peak_db = 0.0;       ///< maximum of the closed loop
  double peak_hz = 0.0;       ///< frequency of the maximum
  bool stable = false;        ///< by the eigenvalues of the sampled loop
  /// Gain margin; negative if the loop is unstable: by how much the gain must fall. Absent if the
  /// phase is never -180 degrees.
  std::optional<double> gain_margin_db;
  /// The least phase margin where the gain is 1. Absent if the gain is never 1.
  std::optional<double> phase_margin_deg;
};
[[nodiscard]] LoopFigures velocity_loop_figures(const FeedAxisParts& parts, double nut);

/// `count` frequencies, evenly spaced on a logarithmic scale [Hz].
[[nodiscard]] Eigen::ArrayXd logarithmic(double from, double to, Eigen::Index count);

}  // namespace servotwin
