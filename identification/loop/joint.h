// Joint identification of loop and friction (thesis chapter 5; docs/theory.md 5).
//
//   1. Pole search with Coulomb friction gives rough poles; then the modes of vibration are added
//      one by one, and the coupling to another axis. If presliding fits a rigid loop better than
//      Coulomb friction, it is used here as well: otherwise the residual of Coulomb friction at
//      reversals is larger than the effect of a mode, and the search mistakes it for a mode.
//   2. The friction's shape parameters with the poles held: a grid, one projection per point.
//   3. All parameters together from the best grid points, by projection. Friction is computed along
//      the measured motion; with a coarse encoder again along the motion simulated with the result.
//   4. Output-error refinement ("polish"): friction is computed along the free simulation.
//
// Step 2 alone gives wrong shapes, because the poles of step 1 compensate for the difference
// between Coulomb friction and the true friction; its results are start values only.
//
// SI units; rotary axes in rad. Bad data do not throw: the functions return nothing. Any thread.
#pragma once

#include <optional>
#include <vector>

#include "identification/loop/output_error.h"
#include "identification/loop/pole_search.h"

namespace servotwin {

/// Every friction model of the catalogue that command and encoder can identify.
[[nodiscard]] std::vector<std::size_t> friction_kinds();
/// The friction models that a joint identification compares by default, the simplest first.
[[nodiscard]] std::vector<std::size_t> compared_frictions();

struct JointFit {
  PoleFit fit;      ///< result of step 3
  Model projected;  ///< the model of `fit`
  Model model;      ///< after step 4; equal to `projected` if step 4 was not requested or failed
  Eigen::MatrixXd covariance;     ///< as from pole_search.h; of step 4 if it was done
  Eigen::Index linear = 0;        ///< index of a1 in it
  double condition_number = 0.0;  ///< of the regressors of step 3
};

/// Step 1, one mode after the other: the start of the fits of all friction models.
class FirstStep {
 public:
  /// `structure` has Coulomb friction or none, no modes and no other axis. `options.from` is empty.
  FirstStep(std::vector<Signals> signals, Structure structure, PoleSearchOptions options);

  /// The fit of `structure` itself; nothing if no candidate has a finite cost.
  [[nodiscard]] const std::optional<PoleFit>& rigid() const { return rigid_; }
  /// Adds one mode; false if no mode is found or there are kMaxModes already.
  [[nodiscard]] bool add_mode();
  /// A start with the modes found so far and, if there is a `coupling`, with that effect of another
  /// axis as the last one. The shapes of Coulomb friction keep their start values.
  [[nodiscard]] std::optional<Point> start(std::optional<std::size_t> coupling = {});

 private:
  bool follow_friction();

  std::vector<Signals> signals_;
  Structure structure_;
  PoleSearchOptions options_;
  std::optional<PoleFit> rigid_;
  // With presliding or Coulomb friction, and with the modes.
  std::optional<Projection> data_;
  std::optional<PoleFit> fit_;
};

/// Steps 1 to 3, and step 4 if `polish`. `structure` contains the friction model, and
/// the coupling as the last effect if there is one; `encoder_step` [m | rad] is that of
/// OutputErrorOptions. If `options.from` has a point (one is used), step 1 is left out and the
/// point's shapes are a further start of step 3. `first`: the result of step 1 if it is known
/// already. `step_s`: for a brief fit, steps 2 and 3 of a law of friction with memory, and the
/// covariance of step 3, use data thinned to a step of at most that, and in step 3 all starts are
/// fitted to fewer data first and only the best to these; 0: all starts to all data. Nothing if no
/// fit is finite.
[[nodiscard]] std::optional<JointFit> joint_fit(const std::vector<Segment>& segments,
                                                const Structure& structure,
                                                const PoleSearchOptions& options,
                                                double encoder_step, bool polish,
                                                const Point* first = nullptr, double step_s = 0.0);

}  // namespace servotwin
