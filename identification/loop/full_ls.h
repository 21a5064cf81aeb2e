// Full least squares, "rapid identification" (thesis 3.3; docs/theory.md 6): the baseline.
//
//   x = th1 E + th2 v + th3 a + th4 x_r + th5 v_r + th6 a_r + th7 PV + th8 NV,   E = integral of e
//
// All parameters at once, linear, from numerical derivatives of the encoder: their noise enters the
// regressors and biases the result, which is why it is here only to be compared with. Order 3 only.
#pragma once

#include <optional>

#include "identification/loop/pole_search.h"

namespace servotwin {

struct FullLsFit {
  Model model;                     ///< loop, Coulomb friction and constant force; may be unstable
  bool poles_in_box = false;       ///< of the unconstrained solution
  bool constrained = false;        ///< the box was imposed
  double friction_positive = 0.0;  ///< d+ [m/s^2 | rad/s^2]
  double friction_negative = 0.0;  ///< d-
  double condition_number = 0.0;   ///< of the regressors in mm and s
};

/// Solves by QR; with `pole_constraints` and poles outside of the box, imposes it (variable
/// projection on the equation error, 18 starts). Nothing where there are too few rows or a number
/// is not finite.
[[nodiscard]] std::optional<FullLsFit> full_ls(const std::vector<Segment>& segments,
                                               const PoleBounds& bounds, bool pole_constraints);

}  // namespace servotwin
