// Modes of vibration whose frequency depends on where the axis stands (twin/loop.h), found in free
// simulation from modes that stand (docs/theory.md 4.8).
#pragma once

#include <optional>
#include <vector>

#include "identification/loop/output_error.h"

namespace servotwin {

/// From `standing`, a polished model of this structure, by the polish with slope, curve and
/// zeta_slope of its modes free over the travel of the segments. Where `standing` moves already,
/// from there alone. Nothing without modes, without travel, where a first round with them free
/// gains next to nothing, or where no fit is valid. Any thread.
[[nodiscard]] std::optional<OutputErrorFit> with_moving_modes(const std::vector<Segment>& segments,
                                                              Structure structure,
                                                              const Model& standing,
                                                              double encoder_step);

}  // namespace servotwin
