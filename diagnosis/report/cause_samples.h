// The samples of a recording with the contribution of a cause: measured, simulated without it and
// simulated with it (equations in diagnosis/report/cause_picture.h).
//
// SI units. Any thread.
#pragma once

#include <cstddef>
#include <vector>

#include "diagnosis/search/diagnose.h"
#include "twin/sample.h"

namespace servotwin {

/// The samples of all segments with the plotted quantities; NaN where nothing is plotted.
struct CauseSamples {
  std::vector<double> velocity, acceleration, neighbour, position, time, since_rest;
  std::vector<double> travel, direction;                       // since the last reversal
  std::vector<double> measured, without, with;                 // force, length or error
  std::vector<double> left_without, left_with;                 // measured less simulated [m | rad]
  std::vector<ResidualStretch> stretch_without, stretch_with;  // the same
  double fastest = 0.0;
};

/// The samples for this cause, which must have an effect in the extended model and a model
/// `without`. `scale`: travel [m | rad] over which friction reverses or a gap is crossed.
[[nodiscard]] CauseSamples samples_of(const Diagnosis& diagnosis, const Cause& cause,
                                      const std::vector<Segment>& segments, double scale);

}  // namespace servotwin
