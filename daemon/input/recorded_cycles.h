// A recording as the cycles of the machine that made it: what is replayed.
//
// The stamps are read by identification/recording/stamps.h and by nothing else, so that a daemon to
// which a recording is replayed sees the samples that `servotwin identify` takes from it. What is
// evenly spaced is numbered; what is not is resampled linearly onto the cycle, except over gaps
// that identification does not bridge. Missing cycles stay missing. Errors: std::runtime_error. Any
// thread.
#pragma once

#include <string>
#include <vector>

#include "twin/sample.h"

namespace servotwin::daemon {

struct RecordedCycles {
  double cycle_s = 0.0;
  Recording recording;  ///< every row stamped with its cycle's time, a whole number of cycles after
                        ///< the first
  std::vector<std::string> notes;  ///< what became of rows that are not as they were, for people
};

/// Throws if time stands still or runs backwards.
[[nodiscard]] RecordedCycles recorded_cycles(Recording recording);

}  // namespace servotwin::daemon
