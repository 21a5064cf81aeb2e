// The informative part of a long recording.
//
// A fit takes time in proportion to the samples, and after some minutes of motion more of the same
// adds little. The recording is divided into as many equal parts as the excerpt has windows, and
// from each part the window is taken that has the most fast motion and slow reversals
// (identification/recording/evidence.h). So the excerpt covers all of the recording's time and what
// is rare in it. Windows that follow each other without a gap are one segment.
//
// Any thread; errors: none. Source: own.
#pragma once

#include <vector>

#include "twin/sample.h"

namespace servotwin {

struct ExcerptLimits {
  double longest_s = 240.0;  ///< a recording up to this length is used as it is
  double used_s = 120.0;     ///< of a longer one
  double window_s = 6.0;
};

/// The segments themselves where they are not longer than `longest_s` together.
[[nodiscard]] std::vector<Segment> excerpt(const std::vector<Segment>& segments,
                                           const ExcerptLimits& limits = {});

}  // namespace servotwin
