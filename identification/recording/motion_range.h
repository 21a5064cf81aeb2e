// Largest speed and acceleration of a motion: of the data of a model, or of a path.
//
//   speed        max |x(t + d) - x(t)| / d
//   acceleration max |x(t + d) - 2 x(t) + x(t - d)| / d^2,   d = kSpan_s
//
// Differences are taken over a span, not from sample to sample, so that quantisation does not count
// as motion (with 1 ms samples, 1 um would be 4 m/s^2 from sample to sample; over 10 ms it is 0.04
// m/s^2).
//
// SI; rotary axes in rad. Any thread; errors: none.
#pragma once

#include <span>
#include <string>

#include "identification/recording/signals.h"
#include "twin/sample.h"

namespace servotwin {

struct MotionRange {
  static constexpr double kSpan_s = 0.01;

  double speed = kAbsent;         ///< largest [m/s | rad/s]; NaN: not known
  double acceleration = kAbsent;  ///< largest [m/s^2 | rad/s^2]
};

/// The range of the commands; NaN if no segment is longer than two spans.
[[nodiscard]] MotionRange motion_range(std::span<const Segment> segments);

/// How much larger the lengths and velocities of this axis are than those of machines in m: its
/// peak speed over kMachineSpeed, at least 1, and 1 on every linear axis (twin/effect.h). Parts of
/// a recording have that of the whole.
void set_length_scale(std::span<Segment> recording, bool rotary);
[[nodiscard]] double length_scale(std::span<const Segment> segments);
[[nodiscard]] double length_scale(std::span<const Signals> segments);

/// Why commands cannot be those of a servo axis, with the unit that may be wrong: faster or longer
/// than any machine. Empty: they can.
[[nodiscard]] std::string why_implausible(std::span<const Segment> segments, bool rotary);

/// Why the actual position cannot be that of an axis which follows this command, with the unit that
/// may be wrong: it travels more than kMaxTravelRatio times as far or less. Empty: it can.
inline constexpr double kMaxTravelRatio = 6.0;
[[nodiscard]] std::string why_not_following(std::span<const Segment> segments, bool rotary);

}  // namespace servotwin
