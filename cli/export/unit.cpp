#include "cli/export/unit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <stdexcept>

#include "cli/export/unit_files.h"
#include "cli/export/zip.h"
#include "twin/twin.h"

extern "C" {
#include "cli/export/sources/effects.h"
}

namespace servotwin {
namespace {

/// A number as text: exact, and the same in every locale; see model_text.h.
std::string exact(double value) {
  int exponent = 0;
  const auto mantissa = static_cast<long long>(std::ldexp(std::frexp(value, &exponent), 53));
  std::array<char, 48> digits{};
  std::snprintf(digits.data(), digits.size(), " %s0x%llxp%d", mantissa < 0 ? "-" : "",
                mantissa < 0 ? -mantissa : mantissa, mantissa == 0 ? 0 : exponent - 53);
  return digits.data();
}

/// The GUID of these bytes, which changes with any of them: FNV-1a with two initial values.
class Fingerprint {
 public:
  void add(std::string_view bytes) {
    for (const char c : bytes) {
      for (std::uint64_t& half : halves_)
        half = (half ^ static_cast<unsigned char>(c)) * 0x100000001b3U;
    }
  }
  [[nodiscard]] std::string guid() const {
    std::array<char, 48> digits{};
    std::snprintf(
        digits.data(), digits.size(), "{%08x-%04x-%04x-%04x-%012llx}",
        static_cast<unsigned>(halves_[0] >> 32), static_cast<unsigned>(halves_[0] >> 16 & 0xffff),
        static_cast<unsigned>(halves_[0] & 0xffff), static_cast<unsigned>(halves_[1] >> 48),
        static_cast<unsigned long long>(halves_[1] & 0xffffffffffffU));
    return digits.data();
  }

 private:
  std::array<std::uint64_t, 2> halves_{0xcbf29ce484222325U, 0x6c62272e07bb0142U};
};

std::string page(const ModelRecord& record, const UnitDescription& unit,
                 const std::vector<std::string>& about) {
  const std::string axis = xml_escaped(record.axis);
  std::string html =
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>Servotwin axis " +
      axis + "</title></head><body>\n<h1>Servotwin axis " + axis + "</h1>\n<p>" +
      "The tracking error of this machine axis, computed from its command: an FMI 2.0 unit for "
      "co-simulation, written by Servotwin " SERVOTWIN_VERSION
      ".</p>\n<h2>The model</h2>\n<pre>\n" +
      "axis        " + axis + (record.rotary ? " (rotary)" : " (linear)") +
      (record.version > 0 ? ", model version " + std::to_string(record.version) : "") + "\n" +
      "identified  " + xml_escaped(record.created) +
      (record.source.empty() ? "" : ", from " + xml_escaped(record.source)) + "\n";
  for (const std::string& line : about) html += xml_escaped(line) + "\n";
  html += "</pre>\n<h2>Variables</h2>\n<table>\n";
  for (const UnitVariable& v : unit.variables)
    html += "<tr><td>" + v.causality + "</td><td>" + v.name + "</td><td>" +
            (v.unit == "1" ? "" : v.unit) + "</td><td>" + xml_escaped(v.meaning) + "</td></tr>\n";
  char sample_time[32];
  std::snprintf(sample_time, sizeof sample_time, "%.9g", record.model.sample_time_s);
  return html + "</table>\n<h2>Use and limits</h2>\n<ul>\n<li>The sample time is " + sample_time +
         " s. A communication step must be a whole multiple of it; any other step is an "
         "error.</li>\n"
         "<li>The command that is set before a step is the command at the end of the step. Between "
         "commands the motion is a cubic through the last four. With the command's derivatives "
         "(fmi2SetRealInputDerivatives, orders 1 to 3) the command is that at the beginning of the "
         "step, and the motion is the cubic with these derivatives.</li>\n"
         "<li>The axis starts at rest at the command that is set when initialization ends.</li>\n"
         "<li>For effects that begin at one moment, time is the time of the recording.</li>\n"
         "<li>The parameters are those of the effects, fixed after initialization. The loop is in "
         "resources/model.txt, discretised for the sample time, with motor and load as two masses "
         "where the model has them.</li>\n"
         "<li>The model is valid for motion like that from which it was identified.</li>\n"
         "<li>The shared library is for Linux on x86-64. For other systems: cc -std=c99 -O2 "
         "-shared -fPIC -DFMI2_OVERRIDE_FUNCTION_PREFIX -o " +
         unit.identifier + ".so sources/*.c -lm</li>\n</ul>\n</body></html>\n";
}

}  // namespace

void require_translated(std::string_view effect) {
  if (servotwin_find_effect(std::string(effect).c_str()) >= 0) return;
  throw std::runtime_error(
      "effect '" + std::string(effect) +
      "' cannot be exported: it has no C translation; identify or diagnose without it");
}

std::string model_text(const Model& model, const std::string& guid, double length_scale) {
  const Twin twin(model);
  const StepConstants& step = twin.step_constants();
  std::string out =
      "# The numbers of this unit's model. Each is a whole number in hexadecimal, times a power of "
      "two.\n"
      "servotwin_unit 1\nguid " +
      guid + "\ncycle_s" + exact(model.sample_time_s) + "\nparts " + std::to_string(step.parts) +
      "\norder " + std::to_string(step.order);
  const auto add_line = [&](const char* name, std::initializer_list<double> values) {
    out += std::string("\n") + name;
    for (const double value : values) out += exact(value);
  };
  add_line("integral", {step.damping, step.integral, step.integral_velocity});
  add_line("direct",
           {step.rate.velocity, step.second.velocity, step.second.acceleration, step.second.force});
  add_line("by_force", {step.error.force_end, step.rate.force_end, step.second.force_end});
  out += "\nstates " + std::to_string(step.states);
  for (std::size_t i = 0; i < static_cast<std::size_t>(step.states); ++i) {
    const StepConstants::Row& row = step.rows[i];
    const std::string block =
        "state " + std::to_string(row.first) + " " + std::to_string(row.width);
    add_line(block.c_str(), {row.phi[0], row.phi[1], row.phi[2], row.command[0], row.command[1],
                             row.command[2], row.force_begin, row.force_end, step.rest[i],
                             step.error.state[i], step.rate.state[i], step.second.state[i]});
  }
  // The modes' share of these constants is that of one position; the data for other positions are
  // needed only if a mode moves.
  const Loop& loop = model.loop;
  if (std::any_of(loop.modes.begin(), loop.modes.end(),
                  [](const Mode& mode) { return mode.moves(); })) {
    const auto [a1, a2, a3] = loop.denominator;
    const auto [c0, c1, c2] = loop.numerator;
    const std::string moving = "moving_modes " + std::to_string(loop.modes.size());
    add_line(moving.c_str(), {a1, a2, a3, c0, c1, c2, loop.travel.from, loop.travel.to});
    for (const Mode& mode : loop.modes)
      add_line("mode", {mode.omega, mode.zeta, mode.alpha, mode.beta, mode.gamma, mode.delta,
                        mode.slope, mode.curve, mode.zeta_slope});
  }
  if (const Effect* two_mass = two_mass_of(model)) {
    const TwoMassParameters two = two_mass_parameters(*two_mass);
    const auto [by_loop, by_motor] = position_gain_of(loop, two);
    TwoMassAxis axis;
    axis.discretise(loop, two, model.sample_time_s / step.parts);
    const TwoMassAxis::Step& of = axis.step();
    const std::string encoders =
        "two_masses " + std::to_string(static_cast<int>(two.encoders));  // as in two_masses.c
    add_line(encoders.c_str(), {two.omega, two.zeta, two.load_share, two.friction_share, two.width,
                                loop.denominator[0], loop.denominator[1], by_loop, by_motor,
                                -loop.numerator[1], 1.0 - loop.numerator[0]});
    for (std::size_t i = 0; i < static_cast<std::size_t>(axis.states()); ++i)
      add_line("mass_state",
               {of.phi[i][0], of.phi[i][1], of.phi[i][2], of.phi[i][3], of.phi[i][4],
                of.command[i][0], of.command[i][1], of.command[i][2], of.motor_begin[i],
                of.motor_end[i], of.load_begin[i], of.load_end[i]});
  }
  out += '\n';
  for (const Effect& effect : effects_of_unit(model)) {
    out += "effect " + std::string(identity_of(effect.kind).id) + "\n";
    const auto add = [&](const char* what, const Parameter& of_machines, double value) {
      const Parameter p = stretched(of_machines, length_scale);
      out += std::string(what) + " " + std::string(p.name) + exact(value) + exact(p.lower) +
             exact(p.upper) + "\n";
    };
    std::size_t k = 0;
    for (const Parameter& p : shapes_of(effect.kind)) add("shape", p, effect.shape[k++]);
    k = 0;
    for (const Parameter& p : coefficients_of(effect.kind))
      add("coefficient", p, effect.coefficient[k++]);
  }
  return out + "end\n";
}

FmuUnit make_unit(const ModelRecord& record, const std::vector<std::string>& about) {
  for (const Effect& effect : effects_of_unit(record.model))
    require_translated(identity_of(effect.kind).id);
  FmuUnit unit;
  unit.description = describe(record);
  const std::string& identifier = unit.description.identifier;
  std::vector<PackedFile> files;
  std::vector<std::string> sources;
  for (const UnitFile& file : unit_files()) {
    std::string content(file.content);
    std::string name = "sources/" + std::string(file.name);
    if (file.name == kUnitLicence) name = "documentation/licenses/license.txt";
    if (file.name == kUnitLibrary) {
#ifdef __x86_64__
      name = "binaries/linux64/" + identifier + ".so";
#else
      continue;  // FMI 2.0 has no name for this processor; hosts can use the sources
#endif
    }
    if (file.name == "identifier.h")
      content += "#define FMI2_FUNCTION_PREFIX " + identifier + "_\n";
    if (name.ends_with(".c")) sources.emplace_back(file.name);
    files.push_back({std::move(name), std::move(content)});
  }
  Fingerprint fingerprint;
  const double scale = record.rotary ? kLargestLengthScale : 1.0;
  fingerprint.add(model_text(record.model, "", scale));
  fingerprint.add(model_description_xml(unit.description, record, sources));
  for (const PackedFile& file : files) fingerprint.add(file.content);
  unit.description.guid = fingerprint.guid();
  files.insert(files.begin(),
               {"modelDescription.xml", model_description_xml(unit.description, record, sources)});
  files.push_back({"resources/model.txt", model_text(record.model, unit.description.guid, scale)});
  files.push_back({"documentation/index.html", page(record, unit.description, about)});
  unit.zip = zipped(files);
  return unit;
}

}  // namespace servotwin
