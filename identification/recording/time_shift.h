// Command and encoder that were not recorded at the same time: the encoder shows the commanded
// motion unchanged, but much later, or before it was commanded.
//
// A slow servo is late as well, but it also smooths the motion: the encoder is compared with the
// command delayed by T, and with the command behind a lag of first order with any time constant.
//
// Units: m | rad, s. Errors: none. Any thread.
#pragma once

#include <span>
#include <string>

#include "twin/sample.h"

namespace servotwin {

/// The end of a sentence that begins with the encoder's name, for an error; empty if both were
/// recorded at the same time, or if nothing can be said (no encoder, short, hardly any motion).
[[nodiscard]] std::string why_at_another_time(std::span<const Segment> segments);

/// As above, for an encoder that is late by 0.05 to 0.25 s: a sentence for a note, since a loop may
/// be as slow. Empty unless the command delayed by that time leaves much less than the command, its
/// slope and its bend do, which are what a slow loop shows.
[[nodiscard]] std::string remark_on_time(std::span<const Segment> segments);

}  // namespace servotwin
