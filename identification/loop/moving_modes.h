// Modes of vibration whose frequency depends on the position of the axis (twin/loop.h), identified
// in free simulation from modes of constant frequency (docs/theory.md 4.8).
#pragma once

#include <optional>
#include <vector>

#include "identification/loop/output_error.h"

namespace servotwin {

/// Refines `standing`, a refined model of this structure with constant modes, in free simulation
/// with slope, curve and zeta_slope of its modes free over the travel of the segments. If the modes
/// of `standing` change with position already, that is the only start. Nothing without modes,
/// without travel, if a first round with these parameters free improves the fit by too little, or
/// if no fit is valid. `encoder_step` [m | rad]. Any thread.
[[nodiscard]] std::optional<OutputErrorFit> with_moving_modes(const std::vector<Segment>& segments,
                                                              Structure structure,
                                                              const Model& standing,
                                                              double encoder_step);

}  // namespace servotwin
