// Motion of one axis that is kept longer than the motion memory, sorted by evidence class
// (identification/recording/evidence.h): of every class the most recent seconds; the oldest are
// dropped first.
//
// A machine changes, for example when a ball screw is replaced. Evidence is therefore dropped when
// the axis has moved for `forgotten_after_s` since the evidence left the recent motion, however
// rare its class. Times are seconds of the motion memory; the age is motion of this axis, so that a
// standing machine drops nothing.
//
// The peaks that separate fast from slow motion are the largest since the start and are not
// dropped: otherwise a machine that only creeps for a while would count creeping as fast motion.
//
// One thread; no clock; errors: none.
#pragma once

#include <array>
#include <initializer_list>
#include <vector>

#include "identification/recording/evidence.h"
#include "twin/sample.h"

namespace servotwin::daemon {

struct EvidenceBounds {
  double fast_s = 24.0, slow_s = 12.0, standstill_s = 8.0;  ///< maximum kept of each class
  double forgotten_after_s = 240.0;                         ///< of motion
};

/// Seconds of motion of each class.
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

  /// Sets new bounds.
  void keep(const EvidenceBounds& bounds) { bounds_ = bounds; }
  /// Forgets the motion, but not the peaks: from here on another axis is beside this one.
  void forget_all() { kept_.clear(); }
  /// Sorts the most recent motion, which must be complete from its first segment on, and replaces
  /// what was kept of that time. `moved_s`: motion of the axis until the end of `recent`. Returns
  /// the seconds of each class later than `new_after_s`.
  EvidenceSeconds take(const std::vector<Segment>& recent, double new_after_s, double moved_s);

  /// The kept motion of these classes in order of time; stretches of one class that follow each
  /// other without a gap are one segment.
  [[nodiscard]] std::vector<Segment> kept(std::initializer_list<Evidence> classes) const;
  [[nodiscard]] EvidenceSeconds seconds() const;

 private:
  struct Kept {
    EvidenceStretch stretch;
    double moved_s = 0.0;  // motion of the axis when the stretch was last recent
  };
  void forget(double moved_s);

  EvidenceBounds bounds_;
  MotionScale scale_;
  std::vector<Kept> kept_;  // in order of time
};

}  // namespace servotwin::daemon
