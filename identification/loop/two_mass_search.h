// Where a fit of two masses in free simulation begins (two_mass_fit.h).
//
// While an axis slides in one direction its friction is a function of speed alone, whatever its
// law. Between two reversals the error of two masses without play is linear in the coefficients of
// that function, in those of the command and in the state at the start of the phase:
//
//   e ~ fixed(gains, spring, masses) + sum_j c_j (..) + sum_i friction_i (..) + starting state (..)
//
// The linear parameters are solved by least squares and projected out, as for a rigid axis
// (projection.h); gains, spring and masses are searched from a grid. No law of friction can stand
// for a spring here, nor a spring for one. In free simulation both can, and a spring that is far
// off is not found at all. Source: docs/theory.md 3.11.
//
// Units: SI, rad for m on rotary axes. Any thread. Errors: none.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "identification/loop/projection.h"
#include "twin/model.h"
#include "twin/sample.h"

namespace servotwin {

struct TwoMassStart {
  Model model;
  double rms = 0.0;  ///< in the phases of sliding [m | rad]
  /// The RMS over all samples if the error outside of these phases were 0 [m | rad]: nearly a lower
  /// bound of what this kind leaves in free simulation with these known forces. It is too large
  /// where friction builds up over a travel that is longer than the way to the begin of a phase.
  double least = 0.0;
};

/// `rigid`, of this structure, as two masses of this kind, without play, its friction of the level
/// that shows, or scaled to the new gains, and mostly on the load: of those that leave hardly more
/// than the least, the one nearest to what machines usually have. A spring
/// that is much faster than the loop leaves hardly less here than a rigid axis; whether there is
/// one, only the reversals tell. Nothing where `rigid` has what these equations do not have (modes,
/// a limit of the motor, a filter of the control), or where no phase is long enough.
[[nodiscard]] std::optional<TwoMassStart> two_mass_start(const std::vector<Segment>& segments,
                                                         const Structure& structure,
                                                         const Model& rigid, std::size_t kind);

}  // namespace servotwin
