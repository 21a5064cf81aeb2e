// How well the noise floor of a recording is found, on machines whose noise is known.
//
// The truth is the RMS that noise and step of the encoder add to the record. Noise of the torque
// moves the axis: it is no noise of the reading.
//
// SI units. Deterministic. Any thread.
#pragma once

#include <ostream>
#include <string>
#include <vector>

#include "identification/recording/noise_floor.h"
#include "tests/hidden_effects/cases.h"

namespace servotwin::hidden_effects {

struct FloorOfCase {
  std::string name;          ///< of the case
  double reading_rms = 0.0;  ///< noise and step of the encoder: the truth [m]
  double noise_rms = 0.0;    ///< the same with the noise of the torque [m]
  RmsEstimate found;         ///< by the program

  [[nodiscard]] bool within() const;  ///< 15 % of the truth
  [[nodiscard]] bool in_interval() const;
};

/// The case number `i` of the part: one machine for every effect in turn, and one without any.
[[nodiscard]] Case case_of_floor(Part part, int i);

/// The noise floor that the program finds in the recording of the case.
[[nodiscard]] FloorOfCase floor_of(const Case& made);

/// One line a case, then the shares within the limits.
void print_floors(const std::vector<FloorOfCase>& floors, std::ostream& out);

}  // namespace servotwin::hidden_effects
