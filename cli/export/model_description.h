// modelDescription.xml of a unit: its variables with their units, bounds and start values.
#pragma once

#include <string>
#include <vector>

#include "identification/model/model_file.h"

namespace servotwin {

struct UnitVariable {
  std::string name;
  unsigned reference = 0;  ///< value reference, as in cli/export/sources/fmu.c
  std::string causality;   ///< input, output or parameter
  std::string unit;        ///< "m", "rad/s", ..; "1" without a unit
  std::string meaning;
  double start = 0.0;  ///< start value and bounds of a parameter
  double lower = 0.0, upper = 0.0;
};

struct UnitDescription {
  std::string identifier;  ///< of the shared library: "servotwin_X"
  std::string guid;        ///< changes with any content of the unit
  std::vector<UnitVariable> variables;
};

/// The effects that are parameters of the unit, in the order of their references: all but two
/// masses, for which the matrices of the unit are computed.
[[nodiscard]] std::vector<Effect> effects_of_unit(const Model& model);
/// The description of a model, except for the GUID.
[[nodiscard]] UnitDescription describe(const ModelRecord& record);
/// The XML. `sources`: names of the C files.
[[nodiscard]] std::string model_description_xml(const UnitDescription& unit,
                                                const ModelRecord& record,
                                                const std::vector<std::string>& sources);
/// Escapes characters for XML text or a quoted attribute.
[[nodiscard]] std::string xml_escaped(const std::string& text);

}  // namespace servotwin
