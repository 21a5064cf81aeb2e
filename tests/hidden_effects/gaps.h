// Why a hidden effect is missed: the three questions of one case, asked in this order.
//
//   representation  The true structure of the twin (order of the loop, a law of friction of the
//                   machine's family, an effect of the true cause), started at the true parameters
//                   and fitted in free simulation to the whole recording: does it leave no more
//                   than kNoiseFactor times the noise? If not, the twin lacks physics. The effect
//                   is started at the truth beside the machine's own loop and friction, and beside
//                   those that a fit without it has.
//   search          The same structure with the shapes that the program's own screening finds: does
//                   it leave no more than kSearchFactor times that? If not, the fit or its start is
//                   at fault.
//   decision        Both do, and the diagnosis names something else.
//
// SI units. Does not throw. Any thread.
#pragma once

#include <string>

#include "tests/hidden_effects/cases.h"

namespace servotwin::hidden_effects {

inline constexpr double kNoiseFactor = 1.2;
inline constexpr double kSearchFactor = 1.1;

struct Gaps {
  double represented_rms = 0.0;  ///< left by the true structure from the true parameters [m]
  double searched_rms = 0.0;     ///< the same from the program's own start [m]
  std::string structure;         ///< that left least from the true parameters

  [[nodiscard]] bool represented(double noise_rms) const {
    return represented_rms <= kNoiseFactor * noise_rms;
  }
  [[nodiscard]] bool found() const { return searched_rms <= kSearchFactor * represented_rms; }
};

/// The case hides one effect, which is in its text. Where nothing can be fitted both errors are
/// 1e300, which counts as not represented. An effect that the twin does not simulate
/// (dropped_samples) counts as represented and found.
[[nodiscard]] Gaps gaps_of(const Case& made);

}  // namespace servotwin::hidden_effects
