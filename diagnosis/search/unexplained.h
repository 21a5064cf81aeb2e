// An empirical term for the part of the residual that no cause explains. It improves the
// prediction, is marked as not understood, and is not a cause.
//
// The term is a force tabulated over position, velocity or acceleration
// (twin/effects/unexplained_force.h), fitted in free simulation while the rest of the model is
// fixed. Of the three, the one is added that predicts each half of the training data best when
// fitted to the other half, provided that it lowers the error significantly.
#pragma once

#include <optional>
#include <vector>

#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

/// The model with the term as its last effect; nothing where no such term lowers the error
/// significantly. Any thread.
[[nodiscard]] std::optional<Model> with_unexplained(const Model& model,
                                                    const std::vector<Segment>& training);

}  // namespace servotwin
