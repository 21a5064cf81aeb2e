// The ends of a path: a correction starts and ends at 0 and looks ahead, so that the error beside
// them stays where the axes do not rest.
//
// Any thread; errors: none.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "ilc/learn.h"

namespace servotwin::daemon {

inline constexpr double kEndRest_s = 0.1;  ///< what an end should rest

[[nodiscard]] bool moves(const Segment& path);
/// Of each end at which they rest for less, a sentence about the axis that rests least there.
[[nodiscard]] std::vector<std::string> short_rests(std::span<const LearnAxis> axes);

}  // namespace servotwin::daemon
