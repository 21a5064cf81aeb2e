#include "cli/export/model_description.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <set>
#include <stdexcept>

extern "C" {
#include "cli/export/sources/effects.h"
#include "twin/effect.h"
}

namespace servotwin {
namespace {

/// Value references, as in cli/export/sources/fmu.c.
enum Reference : unsigned {
  kCommandReference,
  kNeighbourReference,
  kInCutReference,
  kErrorReference,
  kPositionReference,
  kVelocityReference,
  kFirstReference = 16,
  kReferencesPerEffect = ::kMaxShapes + ::kMaxCoefficients
};

/// A unit of the effects' catalogue as powers of base units.
struct CatalogueUnit {
  std::string_view name;
  int length;  // m, or rad of a rotary axis
  int time;    // s
};
constexpr std::array kUnits{CatalogueUnit{"m", 1, 0},      CatalogueUnit{"s", 0, 1},
                            CatalogueUnit{"Hz", 0, -1},    CatalogueUnit{"m/s", 1, -1},
                            CatalogueUnit{"m/s^2", 1, -2}, CatalogueUnit{"1/s", 0, -1},
                            CatalogueUnit{"1/s^2", 0, -2}, CatalogueUnit{"1/s^3", 0, -3},
                            CatalogueUnit{"s/m", -1, 1},   CatalogueUnit{"1/(m s^2)", -1, -2}};

std::string number(double value) {
  std::array<char, 32> digits{};
  return {digits.data(), std::to_chars(digits.data(), digits.data() + digits.size(), value).ptr};
}

bool has_effect(const Model& model, std::size_t kind) { return model.find(kind) != nullptr; }

std::string unit_definitions(const UnitDescription& unit, bool rotary) {
  std::set<std::string> used;
  for (const UnitVariable& variable : unit.variables) used.insert(variable.unit);
  std::string xml = "  <UnitDefinitions>\n";
  for (const CatalogueUnit& one : kUnits) {
    const std::string name = unit_on_axis(one.name, rotary);
    if (used.erase(name) == 0) continue;
    xml += "    <Unit name=\"" + name + "\"><BaseUnit";
    if (one.length != 0) xml += (rotary ? " rad=\"" : " m=\"") + std::to_string(one.length) + "\"";
    if (one.time != 0) xml += " s=\"" + std::to_string(one.time) + "\"";
    xml += "/>";
    if (one.name == "m" && !rotary)
      xml +=
          "<DisplayUnit name=\"mm\" factor=\"1000\"/><DisplayUnit name=\"um\" "
          "factor=\"1000000\"/>";
    if (one.name == "m" && rotary)
      xml += "<DisplayUnit name=\"deg\" factor=\"57.29577951308232\"/>";
    xml += "</Unit>\n";
  }
  used.erase("1");
  if (!used.empty()) throw std::logic_error("no base units of " + *used.begin());
  return xml + "  </UnitDefinitions>\n";
}

std::string real(const UnitVariable& v, bool rotary) {
  std::string xml = "<Real";
  if (v.unit != "1") xml += " unit=\"" + v.unit + "\"";
  if (v.name == "command" || v.name == "position")
    xml += std::string(" displayUnit=\"") + (rotary ? "deg" : "mm") + "\"";
  if (v.name == "tracking_error" && !rotary) xml += " displayUnit=\"um\"";
  if (v.causality == "parameter")
    xml += " min=\"" + number(v.lower) + "\" max=\"" + number(v.upper) + "\"";
  if (v.causality != "output") xml += " start=\"" + number(v.start) + "\"";
  return xml + "/>";
}

}  // namespace

std::string xml_escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        // Control characters are not allowed in XML.
        out += static_cast<unsigned char>(c) < 0x20 && c != '\n' ? ' ' : c;
    }
  }
  return out;
}

std::vector<Effect> effects_of_unit(const Model& model) {
  std::vector<Effect> out = model.effects;
  std::erase_if(out, [](const Effect& effect) { return acts_on_axis(effect.kind); });
  return out;
}

UnitDescription describe(const ModelRecord& record) {
  UnitDescription unit;
  unit.identifier = "servotwin_";
  for (const char c : record.axis)
    unit.identifier += std::isalnum(static_cast<unsigned char>(c)) != 0 ? c : '_';
  const std::string length = unit_on_axis("m", record.rotary);
  const auto add = [&](const char* name, unsigned reference, const char* causality,
                       std::string_view of, const char* meaning) {
    unit.variables.push_back(
        {name, reference, causality, unit_on_axis(of, record.rotary), meaning, 0.0, 0.0, 0.0});
  };
  add("command", kCommandReference, "input", "m",
      "commanded position at the end of the step; the axis starts at rest there");
  if (coupling_of(record.model) != nullptr)
    add("neighbour_acceleration", kNeighbourReference, "input", "m/s^2",
        coupled_by_motion(record.model)
            ? "acceleration of the other axis, of its own motion, at the end of the step"
            : "commanded acceleration of the other axis at the end of the step");
  if (has_effect(record.model, kind_of<CuttingForce>()))
    add("in_cut", kInCutReference, "input", "1", "1 while the tool cuts, else 0");
  add("tracking_error", kErrorReference, "output", "m", "command minus position");
  add("position", kPositionReference, "output", "m", "position as read by the encoder");
  add("velocity", kVelocityReference, "output", "m/s", "velocity of the axis");
  const std::vector<Effect> effects = effects_of_unit(record.model);
  for (std::size_t i = 0; i < effects.size(); ++i) {
    const Effect& effect = effects[i];
    // If a model has an effect twice, a number distinguishes the two.
    const auto twice = std::count_if(effects.begin(), effects.end(),
                                     [&](const Effect& e) { return e.kind == effect.kind; });
    const std::string name = std::string(identity_of(effect.kind).id) +
                             (twice > 1 ? "_" + std::to_string(i + 1) : "") + ".";
    const auto first =
        static_cast<unsigned>(kFirstReference + kReferencesPerEffect * static_cast<unsigned>(i));
    const auto add_parameter = [&](const Parameter& of_machines, unsigned reference, double value) {
      const Parameter p = stretched(of_machines, record.rotary ? kLargestLengthScale : 1.0);
      unit.variables.push_back({name + std::string(p.name), reference, "parameter",
                                unit_on_axis(p.unit, record.rotary), std::string(p.meaning), value,
                                p.lower, p.upper});
    };
    unsigned k = 0;
    for (const Parameter& p : shapes_of(effect.kind)) {
      add_parameter(p, first + k, effect.shape[k]);
      ++k;
    }
    k = 0;
    for (const Parameter& p : coefficients_of(effect.kind)) {
      add_parameter(p, first + ::kMaxShapes + k, effect.coefficient[k]);
      ++k;
    }
  }
  return unit;
}

std::string model_description_xml(const UnitDescription& unit, const ModelRecord& record,
                                  const std::vector<std::string>& sources) {
  const std::string about =
      "Digital twin of axis " + record.axis + (record.rotary ? " (rotary)" : " (linear)") +
      ": its tracking error for a given command" +
      (record.version > 0 ? ", model version " + std::to_string(record.version) : "") +
      (record.source.empty() ? "" : ", identified from " + record.source);
  std::string xml =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n"
      "<fmiModelDescription fmiVersion=\"2.0\" modelName=\"Servotwin axis " +
      xml_escaped(record.axis) + "\" guid=\"" + unit.guid + "\" description=\"" +
      xml_escaped(about) + "\" version=\"" + std::to_string(record.version) +
      "\" license=\"Apache-2.0\" generationTool=\"Servotwin " SERVOTWIN_VERSION
      "\" variableNamingConvention=\"structured\">\n"
      "  <CoSimulation modelIdentifier=\"" +
      unit.identifier +
      "\" canHandleVariableCommunicationStepSize=\"false\" canInterpolateInputs=\"true\" "
      "maxOutputDerivativeOrder=\"0\" canGetAndSetFMUstate=\"true\" "
      "canSerializeFMUstate=\"true\">\n    <SourceFiles>\n";
  for (const std::string& source : sources) xml += "      <File name=\"" + source + "\"/>\n";
  xml += "    </SourceFiles>\n  </CoSimulation>\n" + unit_definitions(unit, record.rotary) +
         "  <LogCategories>\n"
         "    <Category name=\"logStatusError\" description=\"refused calls and their reasons\"/>\n"
         "    <Category name=\"logStatusDiscard\" description=\"requests that the unit cannot "
         "answer\"/>\n"
         "  </LogCategories>\n"
         "  <DefaultExperiment startTime=\"0\" stepSize=\"" +
         number(record.model.sample_time_s) + "\"/>\n  <ModelVariables>\n";
  std::string outputs;
  for (std::size_t i = 0; i < unit.variables.size(); ++i) {
    const UnitVariable& v = unit.variables[i];
    xml += "    <ScalarVariable name=\"" + v.name + "\" valueReference=\"" +
           std::to_string(v.reference) + "\" causality=\"" + v.causality + "\" variability=\"" +
           (v.causality == "parameter" ? "fixed" : "continuous") + "\"" +
           (v.causality == "parameter" ? " initial=\"exact\"" : "") +
           (v.causality == "output" ? " initial=\"calculated\"" : "") +
           (v.meaning.empty() ? "" : " description=\"" + xml_escaped(v.meaning) + "\"") + ">" +
           real(v, record.rotary) + "</ScalarVariable>\n";
    if (v.causality == "output")
      outputs += "      <Unknown index=\"" + std::to_string(i + 1) + "\"/>\n";
  }
  return xml + "  </ModelVariables>\n  <ModelStructure>\n    <Outputs>\n" + outputs +
         "    </Outputs>\n    <InitialUnknowns>\n" + outputs +
         "    </InitialUnknowns>\n  </ModelStructure>\n</fmiModelDescription>\n";
}

}  // namespace servotwin
