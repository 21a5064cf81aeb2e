// The samples of a recording with what a cause does in them: measured, simulated without it,
// simulated with it (equations in diagnosis/cause_picture.h).
//
// SI units. Any thread.
#pragma once

#include <cstddef>
#include <vector>

#include "diagnosis/diagnose.h"
#include "twin/sample.h"

namespace servotwin {

/// The samples of all segments, with what is drawn of them; NaN where nothing is to be drawn.
struct CauseSamples {
  std::vector<double> velocity, acceleration, neighbour, position, time, since_rest;
  std::vector<double> travel, direction;                       // since the axis turned round
  std::vector<double> measured, without, with;                 // force, length or error
  std::vector<double> left_without, left_with;                 // measured less simulated [m | rad]
  std::vector<ResidualStretch> stretch_without, stretch_with;  // the same
  double fastest = 0.0;
};

/// `scale`: the way in which friction turns over or a gap is crossed [m | rad]. The cause has an
/// effect in the extended model, and `without`.
[[nodiscard]] CauseSamples samples_of(const Diagnosis& diagnosis, const Cause& cause,
                                      const std::vector<Segment>& segments, double scale);

}  // namespace servotwin
