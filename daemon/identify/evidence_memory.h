// What is kept of one axis's motion beyond the motion memory, by what it is evidence of
// (identification/recording/evidence.h): the most recent seconds of each class, forgotten oldest
// first.
//
// A machine changes. So evidence is forgotten as well when the axis has moved for
// `forgotten_after_s` since it left the recent motion: what an old ball screw showed is not mixed
// with the new one's for ever, however rare the class. Time in seconds of the motion memory; age in
// seconds of motion of this axis, so that a standing machine forgets nothing.
//
// The peaks by which motion counts as fast or slow are the largest since the start; they are not
// forgotten, or a machine that only creeps for a while would take its creeping for fast motion.
//
// One thread; no clock.
#pragma once

#include <array>
#include <initializer_list>
#include <vector>

#include "identification/recording/evidence.h"
#include "twin/sample.h"

namespace servotwin::daemon {

struct EvidenceBounds {
  double fast_s = 24.0, slow_s = 12.0, standstill_s = 8.0;  ///< most that is kept of each
  double forgotten_after_s = 240.0;                         ///< of motion
};

/// Seconds of each class.
class EvidenceSeconds {
 public:
  [[nodiscard]] double& of(Evidence e) { return seconds_[static_cast<std::size_t>(e)]; }
  [[nodiscard]] double of(Evidence e) const { return seconds_[static_cast<std::size_t>(e)]; }

 private:
  std::array<double, 3> seconds_{};
};

class EvidenceMemory {
 public:
  explicit EvidenceMemory(const EvidenceBounds& bounds) : bounds_(bounds) {}

  /// From now on this much is kept.
  void keep(const EvidenceBounds& bounds) { bounds_ = bounds; }
  /// Sorts the most recent motion, unbroken from its first segment on; replaces what was kept of
  /// that time. `moved_s`: how long the axis has moved by its end. Returns what it shows after
  /// `new_after_s`.
  EvidenceSeconds take(const std::vector<Segment>& recent, double new_after_s, double moved_s);

  /// What is kept of these classes, in order of time; stretches of one class that follow upon each
  /// other without a gap are one segment.
  [[nodiscard]] std::vector<Segment> kept(std::initializer_list<Evidence> classes) const;
  [[nodiscard]] EvidenceSeconds seconds() const;

 private:
  struct Kept {
    EvidenceStretch stretch;
    double moved_s = 0.0;  // of the axis when it was last part of the recent motion
  };
  void forget(double moved_s);

  EvidenceBounds bounds_;
  MotionScale scale_;
  std::vector<Kept> kept_;  // in order of time
};

}  // namespace servotwin::daemon
