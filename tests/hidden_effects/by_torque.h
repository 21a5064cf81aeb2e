// How often what the torque alone names is there, by how much of its residual a cause leaves.
//
// SI units; the torque in the unit of the recording. Deterministic. Any thread.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "tests/hidden_effects/cases.h"

namespace servotwin::hidden_effects {

/// A cause that the torque names.
struct CauseByTorque {
  std::string machine, id;  ///< name of the case; what is named
  double left = 0.0;        ///< residual on held-out data with the cause over that without it
  double confidence = 0.0;
  bool right = false;     ///< hidden in the machine, or its own friction
  bool friction = false;  ///< a law of friction, which nearly every machine has
};

/// The causes that the torque of this recording names. Errors: those of diagnose_torque().
[[nodiscard]] std::vector<CauseByTorque> named_by_torque(const Case& made);

/// The wrong ones by name, then hits and mean confidence by what is left: of causes, and of laws of
/// friction.
void print_by_torque(const std::vector<CauseByTorque>& named, std::ostream& out);

}  // namespace servotwin::hidden_effects
