// A term for what no cause explains, so that the prediction improves all the same. It is marked as
// not understood, and is no cause.
//
// A force over position, velocity or acceleration (twin/effects/unexplained_force.h), fitted in
// free simulation with everything else held. The one that predicts each half of the training data
// best from the other is taken, if it predicts better than nothing by more than chance.
#pragma once

#include <optional>
#include <vector>

#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

/// The model with the term as its last effect; nothing where none predicts. Any thread.
[[nodiscard]] std::optional<Model> with_unexplained(const Model& model,
                                                    const std::vector<Segment>& training);

}  // namespace servotwin
