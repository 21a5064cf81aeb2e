// A command that is recorded more slowly than the encoder beside it, as from an interpolator of
// 4 ms in a trace of 1 ms: held in between, or in every fourth row only. The drive follows what is
// interpolated between the values; steps, or straight lines, would be motion that never was.
//
// Units: m | rad. Errors: none. Any thread. Source: own.
#pragma once

#include <vector>

namespace servotwin {

/// Puts a cubic through the values that are refreshed every `period` rows (Catmull and Rom 1974)
/// in place of what is held or missing between them. A rest stays a rest, and a longer gap a gap.
void interpolate_refreshed(std::vector<double>& command, double period);

/// The period [rows] of a command of which only every so many rows have a value; 0: of another one.
[[nodiscard]] double period_of_sparse(const std::vector<double>& command);

}  // namespace servotwin
