// Play between a motor and its load, looked for in what a rigid axis leaves. A load that slides
// easily coasts through the gap whenever the motor slows down, and hits its other side: the motor
// moves without it until then. When that happens follows from the recorded motion alone, so that
// each width of the gap and each deceleration of the load can be tried without a simulation of
// both.
//
// The fit of two masses (two_mass_fit.h) starts from what is found here: in its own simulation a
// wrong width hits at other times, and no small change of it tells in which direction to go.
//
// Units: SI, rad for m on rotary axes. Source: docs/theory.md 3.11. Any thread; errors: none.
#pragma once

#include <optional>
#include <vector>

#include "identification/loop/projection.h"
#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

struct GapFound {
  double width = 0.0;         ///< [m]
  double deceleration = 0.0;  ///< of the load by its friction alone [m/s^2]
  double load_share = 0.0;    ///< of the moved mass, 0 .. 1
  double explained = 0.0;     ///< share of the squared residual
};

/// The gap that explains most of what `rigid`, of this structure, leaves in the segments; nothing
/// if one explains hardly anything. Friction that yields before it slides explains its own residual
/// as well as a gap does. The recorded encoder is at the motor; each segment has at least 4
/// samples.
[[nodiscard]] std::optional<GapFound> scan_gap(const std::vector<Segment>& segments,
                                               const Structure& structure, const Model& rigid,
                                               double encoder_step);

}  // namespace servotwin
