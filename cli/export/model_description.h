// modelDescription.xml of a unit: its variables with their units, bounds and start values.
#pragma once

#include <string>
#include <vector>

#include "identification/model/model_file.h"

namespace servotwin {

struct UnitVariable {
  std::string name;
  unsigned reference = 0;  ///< as cli/export/sources/fmu.c has them
  std::string causality;   ///< input, output or parameter
  std::string unit;        ///< "m", "rad/s", ..; "1" where it has none
  std::string meaning;
  double start = 0.0;  ///< of parameters, with their bounds
  double lower = 0.0, upper = 0.0;
};

struct UnitDescription {
  std::string identifier;  ///< of the shared library: "servotwin_X"
  std::string guid;        ///< of everything that the unit is made of
  std::vector<UnitVariable> variables;
};

/// All but the GUID.
[[nodiscard]] UnitDescription describe(const ModelRecord& record);
/// `sources`: the C files.
[[nodiscard]] std::string model_description_xml(const UnitDescription& unit,
                                                const ModelRecord& record,
                                                const std::vector<std::string>& sources);
/// For a text or an attribute in quotes.
[[nodiscard]] std::string xml_escaped(const std::string& text);

}  // namespace servotwin
