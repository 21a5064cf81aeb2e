// What another tuning of the same machine would do as well.
//
// A change of the error that a somewhat different loop, feed-forward or level of friction would
// make too names no cause. The directions d e / d p of all of the machine's own numbers p, by
// finite differences of its simulation, are taken out of it by least squares; what is left is the
// effect's own.
//
// SI units. Any thread.
#pragma once

#include <Eigen/Core>

#include "tests/hidden_effects/rig.h"

namespace servotwin::hidden_effects {

class Absorbed {
 public:
  Absorbed(const Rig& rig, const virtual_machine::Trajectory& command, const Trace& clean);

  /// RMS of what is left of `with - without`; infinite where one of them ran away.
  [[nodiscard]] double left_rms(const Trace& with, const Trace& without) const;

 private:
  Eigen::MatrixXd basis_;  ///< orthonormal, one row per sample
};

}  // namespace servotwin::hidden_effects
