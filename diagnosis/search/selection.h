// Selects the causes that are added to a model, one by one, as long as each improves it enough
// (docs/theory.md 10).
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/search/diagnose.h"
#include "diagnosis/search/extension.h"
#include "diagnosis/search/search.h"

namespace servotwin {

/// A cause with the effect that models it.
struct Found {
  Cause cause;
  std::size_t kind = kEffectKinds;
};

struct Selected {
  /// The baseline's structure, with a filter of the control if there is one, refitted in free
  /// simulation.
  Hypothesis settled;
  Hypothesis model;  ///< with all causes, refitted in free simulation
  /// The model without the baseline's delay, where the delay was found not to be needed.
  std::optional<Hypothesis> undelayed;
  std::map<std::string, Found> found;  ///< by cause
  std::vector<std::string> steps;      ///< of the search, as text
};

/// The causes found, starting from a baseline that `search` has fitted. Throws std::runtime_error
/// where the options ask to stop. One thread.
[[nodiscard]] Selected select_causes(Search& search, Hypothesis baseline,
                                     const DiagnoseOptions& options);

}  // namespace servotwin
