// Converts a recording to the servo cycles that are replayed.
//
// The time stamps are interpreted by identification/recording/stamps.h only, so that a daemon that
// replays a recording sees the same samples as `servotwin identify`. Evenly spaced rows are
// numbered; other rows are resampled linearly onto the cycle, except across gaps that
// identification does not bridge. Missing cycles stay missing. Errors: std::runtime_error. Any
// thread.
#pragma once

#include <string>
#include <vector>

#include "twin/sample.h"

namespace servotwin::daemon {

struct RecordedCycles {
  double cycle_s = 0.0;
  Recording recording;  ///< the time of every row is a whole number of cycles after the first row
  std::vector<std::string> notes;  ///< what was done to dropped, repaired and resampled rows
};

/// Throws if the time stamps do not increase.
[[nodiscard]] RecordedCycles recorded_cycles(Recording recording);

}  // namespace servotwin::daemon
