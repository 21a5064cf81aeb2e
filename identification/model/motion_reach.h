// Whether a path is within the motion that the model of an axis covers, and whether any drive could
// follow it.
//
// A model is valid for motion like that of its data: friction and limits of faster motion are not
// in it. Above kMaxRatioToPredict times the speed or the acceleration of its data no result is
// promised. Above kMaxRatioToLearn times both, nothing is learned: the path then has a wrong unit
// (the smallest wrong factor is 25.4 for inch and mm; deg and rad differ by 57, m and mm by 1000),
// and a wrong unit multiplies speed and acceleration alike.
//
// A jump is a step of the command that differs from the step before and from the step after it by
// more than a drive could accelerate within a cycle (kMinJumpAcceleration, 20 g) and by more than
// rounding in the table explains. The axis is taken to stand before the first and after the last
// row. A corner, where the speed changes within a cycle and stays changed, is not a jump.
//
// SI units. Any thread; errors: none.
#pragma once

#include <span>
#include <string>

#include "identification/model/model_file.h"

namespace servotwin {

inline constexpr double kMaxRatioToPredict = 1.5, kMaxRatioToLearn = 10.0;
inline constexpr double kMinJumpAcceleration = 200.0,
                        kMinJumpAccelerationRotary = 2000.0;             ///< [m/s^2], [rad/s^2]
inline constexpr double kMinJumpStep = 1e-4, kMinJumpStepRotary = 1e-3;  ///< [m], [rad]

/// Speed and acceleration of a path relative to those of the model's data; 0: the model states
/// none.
struct MotionReach {
  double speed = 0.0, acceleration = 0.0;
  std::string words;  ///< "X: the command reaches 12 times the speed (3 m/s) and ..", if beyond

  [[nodiscard]] bool beyond() const { return !words.empty(); }
  [[nodiscard]] bool far_beyond() const {
    return speed > kMaxRatioToLearn && acceleration > kMaxRatioToLearn;
  }
};
[[nodiscard]] MotionReach motion_reach(const ModelRecord& record, std::span<const Segment> path);

/// Advice for a path that is far beyond.
inline constexpr const char* kFarBeyondAdvice =
    "that far outside, either a unit in the table is wrong, or the path must first be run and a "
    "model identified from it; nothing is learned";

/// The first jump of a path: "X.command jumps by 50 mm ..", with its row, counted from 1, and
/// advice; empty if there is none.
[[nodiscard]] std::string jump_in(const Segment& path, const std::string& axis, bool rotary);

}  // namespace servotwin
