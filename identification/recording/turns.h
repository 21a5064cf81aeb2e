// Positions that go round: 0 to 360 degrees, or a linear axis whose counter overflows.
//
// A channel goes round at a period if its range is a period at most and it jumps by about that. It
// is unwrapped row by row; over a gap, the other channel tells how far the axis moved. The result
// counts only if command and encoder then agree much better, and if nothing jumps where a turn was
// added: a command that flies back, and an encoder that does, too, stay as they are.
//
// Units: m | rad. Errors: none; what cannot be decided is left as it is. Any thread. Allocates.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

/// The period by which these values, alone, go round; 0 if they do not.
[[nodiscard]] double period_of(const std::vector<double>& values, bool rotary);

/// Unwraps whichever of command and encoder goes round. What was done, or what it could not do.
[[nodiscard]] std::optional<std::string> unwrap(AxisRecord& axis);

}  // namespace servotwin
