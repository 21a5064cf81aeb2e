// Finds the parts of a recorded motion that excite a certain part of the model: fast motion, slow
// reversals, standstill.
//
//   fast motion      |a| >= 0.2 A, and 0.5 s before and after: excites the loop
//   slow reversals   at least two reversals in a row, with travel beyond the breakaway displacement
//                    and a speed of at most 0.1 V before and after each: excites presliding
//                    friction
//   standstill       the command rests for 2 s or more: shows noise only
//
// V and A are the axis's own peaks (MotionScale). Steady motion adds no information and is in no
// stretch. Velocity and acceleration are differences of the command over 20 ms, so that the
// quantisation of a recorded command does not count as acceleration:
//
//   v = (x(t + d) - x(t - d)) / 2d,   a = (x(t + 2d) - 2 x(t) + x(t - 2d)) / (2d)^2,   d = 10 ms
//
// Pure functions; the result depends on the command only. SI units. Any thread, any segments; a
// segment that is too short gives no stretch. Source: the two kinds of motion of the thesis's
// three-step procedure (5.2; docs/theory.md 5).
#pragma once

#include <vector>

#include "twin/sample.h"

namespace servotwin {

enum class Evidence { kFastMotion, kSlowReversals, kStandstill };

/// Peaks of an axis's commanded motion: 99.5 % quantiles over the time in which it moves, so that a
/// single jump of the command in 10 s of motion is ignored.
struct MotionScale {
  double velocity = 0.0;      ///< V [m/s | rad/s]
  double acceleration = 0.0;  ///< A [m/s^2 | rad/s^2]
};

[[nodiscard]] MotionScale motion_scale(const std::vector<Segment>& segments);
/// The larger value of both, for velocity and for acceleration.
[[nodiscard]] MotionScale wider(const MotionScale& left, const MotionScale& right);

struct EvidenceLimits {
  double fast = 0.2;  ///< share of A from which the loop is excited
  double slow = 0.1;  ///< share of V up to which a reversal is slow
  double presliding =
      20e-6;  ///< least travel on both sides of a reversal [m | rad]: a breakaway displacement
  double forgets = 200e-6;  ///< travel in one direction that erases friction's memory [m | rad]
  double response_s = 0.5;  ///< response time of a loop; shorter parts are no evidence
  double rest_s = 2.0;      ///< least time at rest that counts as standstill
};

struct EvidenceStretch {
  Evidence shows = Evidence::kFastMotion;
  Segment segment;  ///< cut from the one it was found in, sample by sample
};

/// In order of time, no sample twice.
[[nodiscard]] std::vector<EvidenceStretch> sorted_by_evidence(const std::vector<Segment>& segments,
                                                              const MotionScale& scale,
                                                              const EvidenceLimits& limits = {});

/// The number of lead-in samples (Segment::lead) of slow reversals that begin in an unknown state
/// of friction: up to the end of the first long leg, which erases friction's memory. Without a leg
/// that long the unknown state lasts for the whole segment. Needs `actual`.
[[nodiscard]] Eigen::Index lead_in(const Segment& slow, const EvidenceLimits& limits = {});

}  // namespace servotwin
