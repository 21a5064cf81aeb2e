// Modes of vibration beside a loop, one more at a time (docs/theory.md 4.7).
//
// The next mode is searched on a grid of frequencies and damping ratios. At each grid point the
// decrease of the residual is computed that the four columns of a mode bring (two of the command,
// two of the disturbance), with all other linear parameters solved again. From the best grid points
// all nonlinear parameters are refined together, so that the result depends neither on the grid nor
// on the loop found without the mode. In addition all modes are refitted from those that vector
// fitting finds in the frequency response from the command's velocity to the tracking error:
// several modes as strong as the loop itself cannot be found one at a time. The fit with the least
// cost is returned.
//
// Units as in projection.h. Any thread. Allocates.
#pragma once

#include <optional>

#include "identification/loop/pole_search.h"

namespace servotwin {

struct ModeFit {
  Projection data;  ///< of the structure with one more mode
  PoleFit fit;
};

/// The best fit with one mode more than `fit`, whose structure is that of `data`. `options` as for
/// the pole search, except the start values. Nothing if no fit is finite or the structure has
/// kMaxModes already. Bad data do not throw.
[[nodiscard]] std::optional<ModeFit> with_one_more_mode(const Projection& data, const PoleFit& fit,
                                                        const PoleSearchOptions& options);

}  // namespace servotwin
