// The correction of a path without a trial: the identified model, turned round.
//
//   u = Q/T (e_l - y(x_r) + (s | 1)/P d(x_r))
//
// e_l is the error of the linear loop, d what friction and all other forces are along the commanded
// motion itself, and y what effects add to the reading alone. With the right model and without
// limits the error that is left is that of Q. A command is smooth and has no noise, so that Q may
// be wide: the bandwidth is the largest one at which no model within the uncertainty becomes worse
// at any frequency than without correction by more than a fiftieth, |1 - Q L T_i| <= kHarmless. At
// 1 itself Q would have to be nothing wherever a model may turn more than 90 degrees from the one
// that was learned on, which no low-pass is. What friction does at a reversal is met with that
// bandwidth too.
//
// The same is the basis that learning may start from: beyond Q it has what Q takes from learning
// (ilc/learn.h).
//
// Any thread. Allocates.
#pragma once

#include "ilc/learning_law.h"
#include "ilc/zero_phase.h"
#include "twin/sample.h"

namespace servotwin {

/// What forces and readings do along the commanded motion, in samples of the segment; those that
/// are linear in the command are part of T and left out.
struct CommandedEffects {
  Eigen::ArrayXd force;    ///< d [m/s^2 | rad/s^2]
  Eigen::ArrayXd reading;  ///< y [m | rad]
};
[[nodiscard]] CommandedEffects commanded_effects(const Model& model, const Segment& segment);

inline constexpr double kHarmless = 1.02;
/// The largest bandwidth with |1 - Q L T_i| <= kHarmless for all models, up to 0.8 of the Nyquist
/// frequency. `law` of kind kInverse.
[[nodiscard]] double harmless_bandwidth(LearningLaw law, std::span<const Transfer> models,
                                        double h);
/// |1 - Q L T| over the frequency: what the correction leaves.
[[nodiscard]] ContractionCurve left_by_feedforward(const LearningLaw& law,
                                                   std::span<const Transfer> models, double h);

/// `law` of kind kInverse, with the bandwidth that the correction shall have.
[[nodiscard]] Eigen::ArrayXd feedforward(const Model& model, const LearningLaw& law,
                                         const Segment& segment, ZeroPhase& filter);

}  // namespace servotwin
