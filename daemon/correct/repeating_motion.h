// Finds out whether the motion of a machine repeats, from the commands of its axes alone.
//
//   rows --> moves: what lies between two rests of kStandstillCycles or more --> each move is the
//   same as an earlier one, or new --> the shortest sequence of moves with which the record ends
//   kMinRepetitions times or more (Z-function of the reversed sequence)
//
// A program repeats sample by sample or not at all, as for the matcher that will recognise it
// (daemon/loop/program_matcher.h): two moves are the same if they have the same number of rows and
// every row of every axis that moves is within the tolerance. Pauses may differ from repetition to
// repetition, as where a person changes the workpiece. A program cannot contain such a pause, so
// the sequence is divided there into parts. Motion that never rests has no part: nothing could
// recognise its begin.
//
// Positions in the axes' own units [m | rad]. Pure: no clock, file or thread; the work is
// proportional to the rows. Errors: none. Source: Gusfield, Algorithms on Strings, Trees, and
// Sequences, 1.4 (Z-function).
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace servotwin::daemon {

/// Two may be chance, or a person who tries something out.
inline constexpr std::size_t kMinRepetitions = 3;
/// A shorter part is over before a correction is recognised and faded in [cycles].
inline constexpr std::size_t kMinPartMotion = 200;
/// Longer pauses count as pauses of differing length [s].
inline constexpr double kLongestInnerPause_s = 10.0;

/// Rows that repeat as they are. They begin and end at rest.
struct RepeatedPart {
  std::size_t first = 0, rows = 0;
  std::uint32_t axes = 0;  ///< that move in it; bit i: axis i
};

struct RepeatingMotion {
  std::vector<std::size_t> begins;  ///< the first row with motion of each repetition, oldest first
  std::vector<RepeatedPart> parts;  ///< of one of the last repetitions, at least one, in its order
  double deviation = 0.0;  ///< largest difference between two rows that count as the same [m | rad]
};

/// The repetition with which the record ends; a move that is not followed by a rest yet does not
/// count. `command`: of each axis, 1 to kMaxAxes, one value per row; NaN is the same as no other
/// value. `tolerance`: within which two rows are the same [m | rad].
[[nodiscard]] std::optional<RepeatingMotion> repeating_motion(
    std::span<const std::vector<double>> command, double sample_time_s, double tolerance);

}  // namespace servotwin::daemon
