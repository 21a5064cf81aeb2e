// Which causes are added to a model, one by one while they earn their place (docs/theory.md 10).
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/diagnose.h"
#include "diagnosis/extension.h"
#include "diagnosis/search.h"

namespace servotwin {

/// A cause with the effect that models it.
struct Found {
  Cause cause;
  std::size_t kind = kEffectKinds;
};

struct Selected {
  Model settled;     ///< the baseline's structure, polished
  Hypothesis model;  ///< with all causes, polished
  /// Where the baseline's delay was found not to be needed: as good without it.
  std::optional<Hypothesis> undelayed;
  std::map<std::string, Found> found;  ///< by cause
  std::vector<std::string> steps;      ///< what was tried, for people
};

/// From a baseline that the search has fitted.
[[nodiscard]] Selected select_causes(Search& search, Hypothesis baseline,
                                     const DiagnoseOptions& options);

}  // namespace servotwin
