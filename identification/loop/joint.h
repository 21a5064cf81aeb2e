// Joint identification of loop and friction (thesis chapter 5; docs/theory.md 5).
//
//   1. Pole search with Coulomb friction: where the poles are, roughly; then the modes of
//      vibration, one by one, and what another axis does. Both are sought with presliding beside
//      them where a rigid loop follows better with it: what Coulomb friction then leaves at
//      reversals is more than what a mode does, and a search would take its place for one.
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

#include "identification/loop/output_error.h"
#include "identification/loop/pole_search.h"

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

/// Step 1, one mode after the other: where the fits of all friction models start.
class FirstStep {
 public:
  /// `structure`: with Coulomb friction or without any, neither modes nor another axis. `options`
  /// without `from`.
  FirstStep(std::vector<Signals> signals, Structure structure, PoleSearchOptions options);

  /// Of the structure itself; nothing where no candidate has a finite cost.
  [[nodiscard]] const std::optional<PoleFit>& rigid() const { return rigid_; }
  /// false where there is none, or kMaxModes already.
  [[nodiscard]] bool add_mode();
  /// With the modes so far, and with the other axis last, if `coupled`; the shapes of Coulomb
  /// friction are the catalogue's.
  [[nodiscard]] std::optional<Point> start(bool coupled);

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

/// Steps 1 to 3, and 4 if `polish`. `structure` names the friction; `encoder_step` [m | rad] as of
/// OutputErrorOptions. With `options.from`, of which one point is used, step 1 is left out and its
/// shapes are a start of step 3 beside those of step 2. `first`: where step 1 led, where that is
/// known already. cross_coupling is the last effect, if any. Nothing where no fit is finite. Any
/// thread.
[[nodiscard]] std::optional<JointFit> joint_fit(const std::vector<Segment>& segments,
                                                const Structure& structure,
                                                const PoleSearchOptions& options,
                                                double encoder_step, bool polish,
                                                const Point* first = nullptr);

}  // namespace servotwin
