// What a recorded motion is evidence of: fast motion, slow reversals, standstill.
//
//   fast motion      |a| >= 0.2 A, and 0.5 s about it: the loop shows in its answer to acceleration
//   slow reversals   at least two reversals in a row, with travel beyond the breakaway displacement
//                    and a speed of at most 0.1 V before and after each: the friction's memory
//                    shows
//   standstill       the command rests for 2 s or more: noise shows, and nothing else
//
// V and A are the axis's own peaks (MotionScale). The rest, steady motion, is evidence of nothing
// new and is in no stretch. Velocity and acceleration are differences of the command over 20 ms, so
// that the steps in which a command is written do not count as acceleration:
//
//   v = (x(t + d) - x(t - d)) / 2d,   a = (x(t + 2d) - 2 x(t) + x(t - 2d)) / (2d)^2,   d = 10 ms
//
// Pure functions; what a motion shows depends on its command alone. SI. Any thread, any segments;
// what is too short shows nothing. Source: the two kinds of motion of the thesis's three-step
// procedure (5.2; docs/theory.md 5).
#pragma once

#include <vector>

#include "twin/sample.h"

namespace servotwin {

enum class Evidence { kFastMotion, kSlowReversals, kStandstill };

/// Peaks of an axis's commanded motion: 99.5 % quantiles over the time in which it moves, so that
/// in 10 s of motion one jump of the command is none.
struct MotionScale {
  double velocity = 0.0;      ///< V [m/s | rad/s]
  double acceleration = 0.0;  ///< A [m/s^2 | rad/s^2]
};

[[nodiscard]] MotionScale motion_scale(const std::vector<Segment>& segments);
/// The larger of both.
[[nodiscard]] MotionScale wider(const MotionScale& left, const MotionScale& right);

struct EvidenceLimits {
  double fast = 0.2;          ///< share of A from which the loop is excited
  double slow = 0.1;          ///< share of V up to which a reversal is slow
  double presliding = 20e-6;  ///< travel that makes a reversal [m | rad]: a breakaway displacement
  double forgets = 200e-6;    ///< travel in one direction after which friction remembers no other
  double response_s = 0.5;    ///< in which a loop answers; what is shorter shows nothing of its own
  double rest_s = 2.0;        ///< of standing from which on it is standstill
};

struct EvidenceStretch {
  Evidence shows = Evidence::kFastMotion;
  Segment segment;  ///< cut from the one it was found in, sample by sample
};

/// In order of time, no sample twice.
[[nodiscard]] std::vector<EvidenceStretch> sorted_by_evidence(const std::vector<Segment>& segments,
                                                              const MotionScale& scale,
                                                              const EvidenceLimits& limits = {});

/// Samples of slow reversals that begin anywhere until the end of the first long leg, which wipes
/// out what friction remembers from before; until then nobody knows it (Segment::lead). Needs
/// `actual`. Reversals without a leg that long keep a force from before as long as they last.
[[nodiscard]] Eigen::Index lead_in(const Segment& slow, const EvidenceLimits& limits = {});

}  // namespace servotwin
