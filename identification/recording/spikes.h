// Single wrong values of an encoder: it is far from both neighbouring rows, and they agree with
// each other. No axis moves away and back within one sample.
//
// With d(k) = x(k) - (x(k-1) + x(k+1)) / 2, a value is a spike where |d(k)| is above what the rest
// of the recording shows and above what an axis can do, and d(k-1) and d(k+1) are -d(k)/2, which
// only a single value gives: the peak of a fast reversal has the same d at its neighbours.
//
// Units: m | rad, s. Errors: none. Any thread.
#pragma once

#include <optional>
#include <string>

#include "twin/sample.h"

namespace servotwin {

/// Replaces the spikes of `actual` by absent values. What was found, for the notes of the
/// recording; nothing if there is none. If there are too many, they stay, and that is said.
std::optional<std::string> leave_out_spikes(AxisRecord& axis, const std::vector<double>& time,
                                            double step_s);

}  // namespace servotwin
