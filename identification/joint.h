// Joint identification of loop and friction (thesis chapter 5; docs/theory.md 5).
//
//   1. Pole search with Coulomb friction: where the poles are, roughly; then the modes of
//      vibration, one by one.
//   2. The friction's shape parameters with those poles held: a grid, every point one projection.
//   3. All of them together from the best of the grid, by projection; friction along the measured
//      motion, and where the encoder is coarse, again along the motion simulated with the result.
//   4. Output-error polish: the free simulation drives the friction.
//
// Step 2 alone returns a wrong shape, because the poles of step 1 have moved to make up for the
// friction that Coulomb is not; its parameters are starting values and nothing else.
#pragma once

#include <optional>
#include <vector>

#include "identification/output_error.h"
#include "identification/pole_search.h"

namespace servotwin {

/// Every friction model of the catalogue that command and encoder can identify.
[[nodiscard]] std::vector<std::size_t> friction_kinds();
/// Those that a joint identification compares of itself, from the simplest to the richest.
[[nodiscard]] std::vector<std::size_t> compared_frictions();

struct JointFit {
  PoleFit fit;      ///< of step 3
  Model projected;  ///< its model
  Model model;      ///< after step 4; `projected` where the polish was not asked for or failed
  Eigen::MatrixXd covariance;     ///< as of the pole search; of step 4 where there was one
  Eigen::Index linear = 0;        ///< where a1..an begin in it
  double condition_number = 0.0;  ///< of the regressors of step 3
};

/// Steps 1 to 3, and 4 if `polish`. `structure` names the friction; `encoder_step` [m | rad] as of
/// OutputErrorOptions. With `options.from`, of which one point is used, step 1 is left out and its
/// shapes are a start of step 3 beside those of step 2. `first`: the result of step 1, where it is
/// known already. Nothing where no fit is finite. Any thread.
[[nodiscard]] std::optional<JointFit> joint_fit(const std::vector<Segment>& segments,
                                                const Structure& structure,
                                                const PoleSearchOptions& options,
                                                double encoder_step, bool polish,
                                                const PoleFit* first = nullptr);

}  // namespace servotwin
