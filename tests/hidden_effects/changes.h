// Machines that are recorded twice, before and after a change.
//
// SI units. Deterministic: the same change and index give the same texts, bit for bit. Errors:
// std::invalid_argument for an unknown change, std::runtime_error where it is too small on all
// drawn machines. Any thread.
#pragma once

#include <string>
#include <vector>

#include "tests/hidden_effects/cases.h"

namespace servotwin::hidden_effects {

struct ChangedMachine {
  std::string before_csv, after_csv;  ///< of the same axis X, with different motion
  std::string machine;                ///< description in one line
  double ratio = 1.0;                 ///< of the quantity that changed, after to before
  std::vector<std::string> own;
  double noise_rms = 0.0;
};

/// The possible changes: causes of the contract.
[[nodiscard]] const std::vector<std::string>& change_ids();

/// `id` empty: nothing changes.
[[nodiscard]] ChangedMachine changed_machine(Part part, const std::string& id, int index);

}  // namespace servotwin::hidden_effects
