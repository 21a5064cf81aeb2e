// Output-error polish: all parameters of a model at once, judged by its free simulation
// (docs/theory.md 5; step 4 of the joint identification).
//
// The projected searches take the friction along the measured motion, whose encoder steps bias what
// happens within them. Here the simulated motion drives the friction, so that nothing measured
// enters but the command, the starting state and the figure that is minimised:
//
//   min  - sum_k log P(r_k),   r = measured - simulated position,
//   P(r) = Phi((q/2 + r)/sigma) + Phi((q/2 - r)/sigma) - 1
//
// An encoder of step q says that the axis is within half a step of its reading, and no more: P is
// the probability of that reading when the simulation is right to within sigma. For sigma much
// larger than q it is ordinary least squares; for a fine simulation and a coarse encoder it is far
// sharper, since only the moments at which the reading changes carry information.
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "identification/loop/projection.h"
#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

struct OutputErrorOptions {
  double encoder_step = 0.0;  ///< q [m | rad]; 0: as fine as it matters
  int rounds = 40;            ///< of Levenberg-Marquardt, each time sigma is estimated
  double tolerance = 1e-5;    ///< of the relative decrease at which a pass ends
  int passes = 6;             ///< how often sigma is estimated at most
};

struct OutputErrorFit {
  Model model;
  double sigma = 0.0;  ///< what the simulation misses, the encoder's steps apart [m | rad]
  double minus_log_likelihood = 0.0;  ///< of all readings, at this sigma
  /// Of all parameters: numerator, coefficients, a1..an, shapes and so on (as `covariance` of the
  /// pole search), and after them slope, curve and zeta_slope of every mode
  /// that moves.
  Eigen::MatrixXd covariance;
  int simulations = 0;
};

/// Polishes `start`, a model of this structure. Nothing where it leaves what is valid. Any thread.
[[nodiscard]] std::optional<OutputErrorFit> output_error(const std::vector<Segment>& segments,
                                                         const Structure& structure,
                                                         const Model& start,
                                                         const OutputErrorOptions& options = {});

}  // namespace servotwin
