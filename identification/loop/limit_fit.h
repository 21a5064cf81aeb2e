// The limit of the motor, fitted in free simulation to the motion of an axis whose loop is known.
//
// How much a limit leaves falls towards the true one from both sides, but not smoothly: it is
// sought on a grid and by a search without derivatives. SI units. Allocates; any thread.
#pragma once

#include <cstddef>
#include <vector>

#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

/// The model with a limit of this form (`kMotorLimits`) whose shapes leave least in the segments.
/// The rest of the model is held. `rms`: what it leaves [m | rad]; infinite where no limit gives a
/// valid model.
struct LimitFit {
  Model model;
  double rms = 0.0;
};
[[nodiscard]] LimitFit with_motor_limit(const Model& loop, std::size_t form,
                                        const std::vector<Segment>& segments);

}  // namespace servotwin
