// Whether two recordings are of one axis: what moves alike lags alike.
//
// The tracking error is regressed on velocity and acceleration of the command and the direction of
// motion, over all of both recordings, and over each alone. Parts of one recording of an axis give
// a ratio of 1.0 to 1.1, two axes of one machine 3.9 (examples/axis_production.csv).
//
// Units: m | rad, s. Errors: none. Any thread.
#pragma once

#include <span>

#include "twin/sample.h"

namespace servotwin {

/// RMS that one regression leaves in both, over that of one each; 1 where nothing can be said (no
/// encoder, no motion).
[[nodiscard]] double common_over_own(std::span<const Segment> one, std::span<const Segment> other);

/// Above this ratio they do not seem to be one axis.
inline constexpr double kMaxCommonOverOwn = 2.0;

}  // namespace servotwin
