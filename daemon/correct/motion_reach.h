// Whether a path is one that the model of an axis, or any drive, can answer for.
//
// A model is known where it was found. Friction and limits of faster motion are not in it, so that
// beyond kBeyond times the speed or the acceleration of its data nothing is promised. Beyond
// kFarBeyond times both, nothing is learned: no unit is mistaken for another by less than 25.4
// (inch; rad and deg 57, m and mm 1000), and a mistaken unit multiplies both alike.
//
// A jump is one step of the command that is out of line with the step before and the step after
// (the axis stands before the first and after the last): by more than a drive could accelerate
// within the cycle (kJump, 20 g) and more than a table's digits could make of it. A corner, where
// the speed changes within a cycle and stays changed, is none.
//
// SI. Any thread; errors: none.
#pragma once

#include <span>
#include <string>

#include "identification/model/model_file.h"

namespace servotwin::daemon {

inline constexpr double kBeyond = 1.5, kFarBeyond = 10.0;
inline constexpr double kJump = 200.0, kJumpRotary = 2000.0;         ///< [m/s^2], [rad/s^2]
inline constexpr double kLeastJump = 1e-4, kLeastJumpRotary = 1e-3;  ///< [m], [rad]

/// How many times the motion of the model's data the path is; 0: the model does not say.
struct MotionReach {
  double speed = 0.0, acceleration = 0.0;
  std::string words;  ///< "X: the command reaches 12 times the speed (3 m/s) and ..", if beyond

  [[nodiscard]] bool beyond() const { return !words.empty(); }
  [[nodiscard]] bool far_beyond() const { return speed > kFarBeyond && acceleration > kFarBeyond; }
};
[[nodiscard]] MotionReach motion_reach(const ModelRecord& record, std::span<const Segment> path);

/// What to do about a path that is far beyond.
inline constexpr const char* kFarBeyondAdvice =
    "that far outside, either a unit in the table is wrong, or the path must first be run and a "
    "model identified from it; nothing is learned";

/// The first jump: "X.command jumps by 50 mm ..", with its row, counted from 1, and what to do;
/// empty: there is none.
[[nodiscard]] std::string jump_in(const Segment& path, const std::string& axis, bool rotary);

}  // namespace servotwin::daemon
