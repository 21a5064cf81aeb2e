// The correction of a path from the identified model, without a trial.
//
//   u = Q/T (e_l - y(x_r) + (s | 1)/P d(x_r))
//
// On an axis of two masses d acts on motor or load, each with its own response, and play is left to
// the trials.
//
// e_l is the error of the linear loop, d the force of friction and all other effects along the
// commanded motion itself, y what effects add to the reading alone. With the right model and
// without limits the remaining error is that of Q.
//
// A command is smooth and without noise, so Q may be wide. Its bandwidth is the largest for which
// no model within the uncertainty becomes worse than without correction by more than a fiftieth at
// any frequency: |1 - Q L T_i| <= kMaxErrorRatioAtAnyFrequency. A limit of 1 would require Q = 0
// wherever a model may differ in phase from the nominal one by more than 90 degrees, which no
// low-pass satisfies. This bandwidth also corrects the effect of friction at reversals.
//
// The same correction is the basis of learning: beyond Q it supplies what Q removes from learning
// (ilc/learn.h).
//
// Units: m | rad, s. Any thread. Allocates. Source: docs/theory.md 13.3.
#pragma once

#include "ilc/learning_law.h"
#include "ilc/zero_phase.h"
#include "twin/sample.h"

namespace servotwin {

/// Forces and readings along the commanded motion, one value per sample of the segment. Parts that
/// are linear in the command belong to T and are left out.
struct CommandedEffects {
  Eigen::ArrayXd force;       ///< d [m/s^2 | rad/s^2]; of two masses that on the motor
  Eigen::ArrayXd load_force;  ///< of two masses that on the load
  Eigen::ArrayXd reading;     ///< y [m | rad]
};
[[nodiscard]] CommandedEffects commanded_effects(const Model& model, const Segment& segment);

/// Limit of |1 - Q L T_i|: no more than a fiftieth worse than without correction.
inline constexpr double kMaxErrorRatioAtAnyFrequency = 1.02;
/// The largest bandwidth with |1 - Q L T_i| <= kMaxErrorRatioAtAnyFrequency for all models, up to
/// 0.8 of the Nyquist frequency [Hz]. `law` is of kind kInverse; `h` is the sampling time [s].
[[nodiscard]] double harmless_bandwidth(LearningLaw law, std::span<const Transfer> models,
                                        double h);
/// |1 - Q L T| over the frequency: the share of the error that the correction leaves.
[[nodiscard]] ContractionCurve left_by_feedforward(const LearningLaw& law,
                                                   std::span<const Transfer> models, double h);

/// The correction u [m | rad], one value per sample. `law` is of kind kInverse and has the
/// bandwidth of the correction.
[[nodiscard]] Eigen::ArrayXd feedforward(const Model& model, const LearningLaw& law,
                                         const Segment& segment, ZeroPhase& filter);

}  // namespace servotwin
