// Modes of vibration beside a loop, one more at a time (docs/theory.md 4.7).
//
// Where the next one lies is sought on a grid of frequencies and damping ratios: at each, what the
// residual of the fit would lose by the four columns of a mode there (two of the command, two of
// the disturbance), all other linear parameters solved anew. From the best of the grid all
// nonlinear parameters are refined together, so that neither the grid nor the loop found without
// the mode decides. Beside that all modes are begun anew from those that vector fitting sees in the
// frequency response from the command's velocity to the error: where several are as clear as the
// loop itself, none of them is found alone. The least cost decides.
#pragma once

#include <optional>

#include "identification/loop/pole_search.h"

namespace servotwin {

struct ModeFit {
  Projection data;  ///< of the structure with one more mode
  PoleFit fit;
};

/// The best fit with one mode more than `fit`, whose structure `data` has; `options` as for the
/// pole search, but where to start. Nothing where there is no finite one, or the structure has
/// kMaxModes already. Does not throw for bad data.
[[nodiscard]] std::optional<ModeFit> with_one_more_mode(const Projection& data, const PoleFit& fit,
                                                        const PoleSearchOptions& options);

}  // namespace servotwin
