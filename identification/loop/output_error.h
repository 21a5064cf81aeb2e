// Output-error refinement ("polish"): all parameters of a model at once, fitted to its free
// simulation (docs/theory.md 5; step 4 of the joint identification).
//
// The projected searches compute friction along the measured motion, in which encoder steps bias
// motion of less than a step. Here friction is computed along the simulated motion, so that
// measurements enter only through the command, the starting state and the minimised cost:
//
//   min  - sum_k log P(r_k),   r = measured - simulated position,
//   P(r) = Phi((q/2 + r)/sigma) + Phi((q/2 - r)/sigma) - 1
//
// An encoder of step q states only that the axis is within half a step of its reading. P is the
// probability of that reading if the simulation has the standard deviation sigma. For sigma much
// larger than q this is ordinary least squares; for an accurate simulation and a coarse encoder it
// is much more precise, because the times at which the reading changes carry the information.
// An axis of two masses whose recording has the readings of the motor's encoder as well
// (`actual_motor`) is fitted to both, each with its own deviation. The difference of their zeros is
// free. The torque of the motor is a further output where it is asked for.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "identification/loop/coordinates.h"
#include "identification/loop/projection.h"
#include "identification/model/motor_torque.h"
#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

struct OutputErrorOptions {
  double encoder_step = 0.0;  ///< q [m | rad]; 0: quantisation is negligible
  int rounds = 40;            ///< of Levenberg-Marquardt, each time sigma is estimated; with play
                              ///< at most 6
  double tolerance = 1e-5;    ///< of the relative decrease at which a pass ends
  int passes = 6;             ///< how often sigma is estimated at most
  bool covariance = true;     ///< false: not computed, which saves a simulation
  Held held = {};             ///< is not fitted
  std::optional<TorqueLag> torque = {};  ///< fitted to the torque as well, which has this lag
};

struct OutputErrorFit {
  Model model;
  double sigma = 0.0;                 ///< residual deviation without quantisation [m | rad]
  double motor_sigma = kAbsent;       ///< that of the motor's readings, where they were used
  double torque_sigma = kAbsent;      ///< that of the torque, in its unit, where it was used
  double minus_log_likelihood = 0.0;  ///< over all readings, at this sigma
  /// Of all parameters: numerator, coefficients, a1..an, shapes and so on (as `covariance` of the
  /// pole search), and after them slope, curve and zeta_slope of every mode
  /// that moves. Empty where it was not asked for; 0 of what was held.
  Eigen::MatrixXd covariance;
};

/// Refines `start`, a model of this structure. Nothing if the result is not a valid model, or if
/// all of it is held. Any thread.
[[nodiscard]] std::optional<OutputErrorFit> output_error(const std::vector<Segment>& segments,
                                                         const Structure& structure,
                                                         const Model& start,
                                                         const OutputErrorOptions& options = {});

/// The covariance, as that of the fit, at a model that was fitted before. Nothing if it cannot be
/// simulated or differentiated there. Any thread.
[[nodiscard]] std::optional<Eigen::MatrixXd> covariance_at(const std::vector<Segment>& segments,
                                                           const Structure& structure,
                                                           const Model& model, double encoder_step);

/// For every block of segments the model that `output_error` would find on the other blocks, by one
/// Gauss-Newton step (least_squares/jackknife.h) from `at`, which was fitted to all of them. Every
/// segment is simulated from its own starting state. Where the step is not valid or does not lower
/// the cost of the other blocks it is shortened; where a short one does not either, the block gets
/// `at`; where one block cannot be simulated or differentiated, all do. Any thread.
[[nodiscard]] std::vector<Model> left_out(const std::vector<std::vector<Segment>>& blocks,
                                          const Structure& structure, const Model& at,
                                          double encoder_step);

}  // namespace servotwin
