// A recording that begins while the axis still runs to the place where its command is: the error is
// then many times what it is ever after, and no loop that follows a command makes it so.
//
// Units: m | rad, s. Errors: none. Any thread.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

/// Replaces the values of `actual` until the axis has arrived by absent ones. What was found, for
/// the notes of the recording; nothing if the axis begins where its command is, or if that takes a
/// large part of the recording or of its motion: then it is the motion.
std::optional<std::string> leave_out_run_in(AxisRecord& axis, const std::vector<double>& time);

}  // namespace servotwin
