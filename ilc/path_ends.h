// The ends of a path. A correction is 0 at both ends and acts ahead of the motion, so the error
// near an end remains unless the axes rest there.
//
// Any thread; errors: none.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "ilc/learn.h"

namespace servotwin {

inline constexpr double kEndRest_s = 0.1;  ///< minimum rest at an end

/// Whether the command of the path changes at all.
[[nodiscard]] bool path_moves(const Segment& path);
/// For each end at which an axis rests for less than kEndRest_s: a sentence about the axis with the
/// shortest rest.
[[nodiscard]] std::vector<std::string> short_rests(std::span<const LearnAxis> axes);

}  // namespace servotwin
