// What is wrong with the positions of a recording before anything is fitted to them, and its
// repair.
//
// For every axis, in this order, from command and encoder together:
//   1. Positions that go round (0 to 360 degrees) are unwrapped (turns.h).
//   2. A command that is recorded more slowly than the encoder is interpolated (slow_command.h).
//      Single wrong values of the encoder are left out (spikes.h), and so is its way to where the
//   command is, where the recording begins with that (run_in.h).
//   3. An encoder that counts against its command gets the other sign.
//   4. An encoder that moves 0.4 to 2.5 times as far as its command, and not as far, is divided by
//      that ratio (gear ratio, unit or pitch). Only where it rested at places far apart: in motion
//      a lag can look like a ratio.
//   5. An encoder whose zero is elsewhere at rest gets that of the command; where it may as well be
//      an axis that does not reach its command, that is only reported.
//   6. Reported, and left as it is: an encoder that is refreshed more slowly than it is recorded,
//      an encoder ahead of its command, a travel so small that its unit may be wrong.
// An encoder of the motor beside that of the load is repaired in the same way, but for its zero.
// Each repair is far from what a machine does (`PositionLimits`), so that thermal growth, lead
// errors and backlash stay as they are.
//
// Units: m | rad, s. Errors: none; what cannot be decided is left as it is. Any thread. Allocates.
#pragma once

#include <numbers>
#include <string>
#include <vector>

#include "twin/sample.h"

namespace servotwin {

/// Of the travel of an encoder over that of its command, or the reverse: a diameter for a radius is
/// 2. Beyond, they are in different units or not of one axis.
inline constexpr double kMaxEncoderRatio = 2.5;

struct PositionLimits {
  double ratio = 0.003;      ///< least deviation of the ratio from 1; a pitch error is below 0.001
  double offset_m = 1e-3;    ///< least error at rest that is named; thermal growth is below 0.2 mm
  double offset_rad = 0.01;  ///< the same of a rotary axis
  /// The error at rest from which it is another zero: a control stops an axis long before it stands
  /// that far from its command. Below it may be a load that a loop without integral action holds.
  double other_zero_m = 10e-3;
  double other_zero_rad = std::numbers::pi / 18.0;  ///< 10 degrees
  double other_zero_share = 0.2;  ///< of the travel, where that is less: no axis is used like that
  /// Least time by which an encoder is ahead of its command at constant speed to be reported.
  double ahead_s = 1e-3;
  /// Greatest RMS that sign, ratio, zero and lag leave, over that of the motion.
  double unexplained = 0.02;
};

/// Repairs the positions of every axis. One line per repair or finding, beginning with the axis;
/// also in the notes of the recording, which tell how it was made. `only`: no line about the
/// encoders of the other axes.
std::vector<std::string> mend_positions(Recording& recording, const std::string& only = "",
                                        const PositionLimits& limits = {});

}  // namespace servotwin
