// The part of an effect that another tuning of the same machine would produce as well.
//
// A change of the tracking error that a slightly different loop, feed-forward or friction level
// would also produce is evidence of no cause. Therefore the sensitivities d e / d p to all
// parameters p of the machine, by finite differences of its simulation, are projected out of the
// change by least squares; the remainder is specific to the effect.
//
// SI units. Any thread.
#pragma once

#include <Eigen/Core>

#include "tests/hidden_effects/rig.h"

namespace servotwin::hidden_effects {

class Absorbed {
 public:
  Absorbed(const Rig& rig, const virtual_machine::Trajectory& command, const Trace& clean);

  /// RMS of the remainder of `with - without`; infinite where one of them ran away.
  [[nodiscard]] double left_rms(const Trace& with, const Trace& without) const;

 private:
  Eigen::MatrixXd basis_;  ///< orthonormal, one row per sample
};

}  // namespace servotwin::hidden_effects
