// A model as a unit of FMI 2.0 for co-simulation: a zip with what it is in XML, the numbers of the
// model, the program as a shared library and as C sources, and a page for people (docs/files.md).
//
// The same model makes the same unit, byte for byte. Throws std::runtime_error where an effect has
// no C translation. Any thread. Source: Functional Mock-up Interface 2.0.5 (fmi-standard.org).
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "cli/export/model_description.h"
#include "identification/model/model_file.h"

namespace servotwin {

struct Unit {
  UnitDescription description;
  std::string zip;
};

/// `about`: lines for people, of what the model is and how well it predicts.
[[nodiscard]] Unit make_unit(const ModelRecord& record, const std::vector<std::string>& about);

/// Throws std::runtime_error that names the effect if there is none of this id in the C sources.
void require_translated(std::string_view effect);

/// What cli/export/sources/model_text.h reads.
[[nodiscard]] std::string model_text(const Model& model, const std::string& guid);

}  // namespace servotwin
