// Full least squares, "rapid identification" (thesis 3.4; docs/theory.md 6): the baseline that the
// pole search is compared with.
//
//   x = th1 E + th2 v + th3 a + th4 x_r + th5 v_r + th6 a_r + th7 PV + th8 NV
//
// E is the integrated tracking error, PV = [v > 0], NV = -[v < 0]. All parameters are linear and
// fitted at once. The regressors contain numerical derivatives of the encoder, whose noise biases
// the result. Order 3 only. Units: m or rad, s. Any thread. Allocates.
#pragma once

#include <optional>

#include "identification/loop/pole_search.h"

namespace servotwin {

struct FullLsFit {
  Model model;                     ///< loop, Coulomb friction and constant force; may be unstable
  bool poles_in_box = false;       ///< those of the unconstrained solution
  bool constrained = false;        ///< the box had to be imposed
  double friction_positive = 0.0;  ///< d+ [m/s^2 | rad/s^2]
  double friction_negative = 0.0;  ///< d-
  double condition_number = 0.0;   ///< 2-norm, of the regressors in mm and s
};

/// Solves by QR. With `pole_constraints` and poles outside the box, the box is imposed by variable
/// projection on the equation error, from 18 starts. Returns nothing where there are too few rows
/// or a number is not finite.
[[nodiscard]] std::optional<FullLsFit> full_ls(const std::vector<Segment>& segments,
                                               const PoleBounds& bounds, bool pole_constraints);

}  // namespace servotwin
