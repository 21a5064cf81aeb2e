// Exports a model as an FMI 2.0 unit for co-simulation: a zip with an XML description, the numbers
// of the model, the simulation as a shared library and as C sources, and an HTML page
// (docs/files.md). The same model gives the same unit, byte for byte. Throws std::runtime_error if
// an effect has no C translation. Any thread. Source: Functional Mock-up Interface 2.0.5
// (fmi-standard.org).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "cli/export/model_description.h"
#include "identification/model/model_file.h"

namespace servotwin {

struct FmuUnit {
  UnitDescription description;
  std::string zip;
};

/// `about`: lines of text for the page, which describe the model and its prediction errors.
[[nodiscard]] FmuUnit make_unit(const ModelRecord& record, const std::vector<std::string>& about);

/// Throws std::runtime_error with the id of the effect if the C sources do not have it.
void require_translated(std::string_view effect);

/// The numbers of the model as text, which cli/export/sources/model_text.h reads.
/// `stretch`: of the bounds of its parameters (twin/effect.h).
[[nodiscard]] std::string model_text(const Model& model, const std::string& guid,
                                     double stretch = 1.0);

}  // namespace servotwin
