// The diagnosis of a recording, as read from the diagnosis file.
//
// SI units. Any thread.
#pragma once

#include <string>
#include <vector>

#include "tests/hidden_effects/effects.h"

namespace servotwin::hidden_effects {

struct NamedCause {
  std::string id;
  double confidence = 0.0;
  std::vector<std::string> ambiguous_with;
  Parameters parameters;
  bool by_torque = false;  ///< and by nothing else
};

struct Answer {
  std::string failure;  ///< text of the exception; empty: there is an answer
  std::string verdict;  ///< of the contract
  std::vector<NamedCause> causes, suspected;
  double before_rms = 0.0, after_rms = 0.0;  ///< on the hold-out, baseline and extended [m]
  double seconds = 0.0;                      ///< CPU time of the diagnosis alone
  double wall_seconds = 0.0;                 ///< wall time of the same
};

/// Reads the text as a recording and diagnoses its axis X. Does not throw.
[[nodiscard]] Answer ask(const std::string& csv, const std::vector<std::string>& leave_out);

/// Compares the second recording of axis X with the model of the first. Does not throw.
[[nodiscard]] Answer ask_what_changed(const std::string& before_csv, const std::string& after_csv);

}  // namespace servotwin::hidden_effects
