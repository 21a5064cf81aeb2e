// What another axis of the machine does to this one: the acceleration of its command, or of its own
// motion where that is known (effect cross_coupling_by_motion).
//
// Predicted, that motion follows from commands alone, and with it both axes as one machine: each is
// simulated with the predicted motion of the other.
//
// Units: m | rad, s. Pure; any thread. Errors: std::invalid_argument of the simulation, and where
// the axes push each other so strongly that their motions do not settle. Source:
// docs/theory.md 3.11.
#pragma once

#include <Eigen/Core>

#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

/// The acceleration of the other axis, sample by sample [m/s^2 | rad/s^2]: of its motion if
/// `by_motion` and the segment has it, else of its command; empty if that is not known.
[[nodiscard]] Eigen::ArrayXd neighbour_acceleration(const Segment& segment, bool by_motion);

/// Sets the motion of the other axis to what `other`, its model, predicts. If it is measured so
/// far, the prediction begins within that motion, else at rest. `pushes_back`: `other` contains the
/// force of this axis, whose motion `model` predicts; else `other` is left without its coupling.
/// Nothing happens without the other axis' command.
void predict_neighbour(Segment& segment, const Model& model, const Model& other, bool pushes_back);

}  // namespace servotwin
