// The axis whose acceleration acts on another one, where several move with it: the one that
// explains most of what a model without it leaves. Screened (diagnosis/search/screen.h), not
// fitted: whether a coupling is there at all decides the fit that uses it.
//
// Any thread; no clock.
#pragma once

#include <string>
#include <vector>

#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

struct Recording;

/// Share of the squared error that a model leaves on left-out blocks which the acceleration of
/// another axis explains beside the model; at most 1, not above 0 where it explains nothing.
/// `own`: the motion as the model simulates it; `beside`: the same motion with the command of the
/// axis in question as its neighbour. Errors: std::invalid_argument of the simulation.
[[nodiscard]] double share_of_neighbour(const Model& model, const std::vector<Segment>& own,
                                        const std::vector<Segment>& beside);

/// The name of the axis that acts on `axis`, beside models that are identified for this; empty
/// where the recording has fewer than two other axes with commands, none of them explains anything,
/// or no model can be identified. Takes some seconds.
[[nodiscard]] std::string acting_axis(const Recording& recording, const std::string& axis);

}  // namespace servotwin
