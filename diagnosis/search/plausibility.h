// Whether a fitted model can be that of a machine. SI units. Any thread.
#pragma once

#include "twin/model.h"

namespace servotwin {

/// Whether a model is physically plausible beyond the bounds of its single parameters, fitted to a
/// recording of this time. `max_deviation`: of the coefficient of a torque limit from 1.
/// `encoder_step` [m | rad]: a gap below it cannot be seen; 0 where it is not known.
[[nodiscard]] bool plausible(const Model& model, double begin_s, double end_s, double max_deviation,
                             double encoder_step);

}  // namespace servotwin
