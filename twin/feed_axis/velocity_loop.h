// The velocity loop of a feed axis as frequency response: what stage 1 of paper 002 measures (its
// fig. 5; docs/theory.md 16.4). Linear: without friction, with the nut at one place.
//
// From the matrices, sampled as the control sees them: with L(z) = control(z) P(z), P the motor's
// velocity under a torque that holds over a cycle, the closed loop is L / (1 + L). It is the loop
// that FeedAxis simulates, not an approximation of it.
//
// Frequencies are in Hz, below half of the control's rate. Errors: none. Allocates. Any thread.
#pragma once

#include <Eigen/Core>
#include <optional>

#include "twin/feed_axis/ball_screw.h"

namespace servotwin {

/// The closed loop, from the commanded to the motor's velocity [1].
[[nodiscard]] Eigen::ArrayXcd closed_velocity_loop(const FeedAxisParts& parts, double nut,
                                                   const Eigen::ArrayXd& frequency_hz);

/// What a loop is judged by.
struct LoopFigures {
  double bandwidth_hz = 0.0;  ///< below which the closed loop stays above -3 dB
  double peak_db = 0.0;       ///< most of the closed loop
  double peak_hz = 0.0;       ///< where that is
  bool stable = false;        ///< by the eigenvalues of the sampled loop
  /// By how much the gain may rise; of a loop that is not stable, negative, by how much it must
  /// fall. Absent: the phase is nowhere -180 degrees.
  std::optional<double> gain_margin_db;
  /// Between the phase and -180 degrees where the gain is 1, the least. Absent: it is 1 nowhere.
  std::optional<double> phase_margin_deg;
};
[[nodiscard]] LoopFigures velocity_loop_figures(const FeedAxisParts& parts, double nut);

/// As many frequencies, evenly on a logarithmic scale [Hz].
[[nodiscard]] Eigen::ArrayXd logarithmic(double from, double to, Eigen::Index count);

}  // namespace servotwin
