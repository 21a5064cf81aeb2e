// servotwin export: writes a model for other programs, as an FMI 2.0 unit and as matrices.
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/common/command.h"
#include "cli/common/model_text.h"
#include "cli/common/option_table.h"
#include "cli/common/output.h"
#include "cli/export/unit.h"
#include "drivers/common/text.h"
#include "drivers/recordings/matlab/mat_writer.h"
#include "twin/state_space.h"
#include "twin/two_mass_axis.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

inline constexpr const char* kExportSchema = "servotwin.export/1";

struct ExportArguments {
  std::filesystem::path model, unit, matrices, result;
  double position = kAbsent;  // of the axis in the matrices [m | rad]; modes may vary with it
};

/// Names of the rows and columns of the matrices, in their order.
struct Names {
  std::vector<std::string> states, inputs, outputs, cycle_inputs;
};

/// Of an axis of two masses.
Names two_mass_names(const std::string& x, int order) {
  Names names;
  names.states = {"motor_error [" + x + "]", "motor_error_rate [" + x + "/s]",
                  "deflection [" + x + "]", "deflection_rate [" + x + "/s]"};
  if (order == 3) names.states.push_back("integral [" + x + "/s^2]");
  names.states.push_back("command [" + x + "]");
  names.inputs = {"command_velocity [" + x + "/s]", "motor_disturbance [" + x + "/s^2]",
                  "load_disturbance [" + x + "/s^2]"};
  names.outputs = {"tracking_error [" + x + "]", "position [" + x + "]", "velocity [" + x + "/s]",
                   "motor_velocity [" + x + "/s]", "load_velocity [" + x + "/s]"};
  names.cycle_inputs = {
      "command_velocity [" + x + "/s]",         "command_acceleration [" + x + "/s^2]",
      "command_jerk [" + x + "/s^3]",           "motor_disturbance [" + x + "/s^2]",
      "motor_disturbance_rate [" + x + "/s^3]", "load_disturbance [" + x + "/s^2]",
      "load_disturbance_rate [" + x + "/s^3]"};
  return names;
}

Names names_of(const ModelRecord& record) {
  const std::string x = record.rotary ? "rad" : "m";
  if (two_mass_of(record.model) != nullptr) return two_mass_names(x, record.model.loop.order);
  Names names;
  for (int i = 0; i < record.model.loop.order; ++i)
    names.states.push_back(i == 0 ? "tracking_error [" + x + "]"
                                  : text("observer_%d [%s/s^%d]", i + 1, x.c_str(), i));
  for (std::size_t i = 1; i <= record.model.loop.modes.size(); ++i) {
    names.states.push_back(text("mode_%zu_error [%s]", i, x.c_str()));
    names.states.push_back(text("mode_%zu_observer [%s/s]", i, x.c_str()));
  }
  names.states.push_back("command [" + x + "]");
  names.inputs = {"command_velocity [" + x + "/s]", "disturbance [" + x + "/s^2]"};
  names.outputs = {"tracking_error [" + x + "]", "position [" + x + "]", "velocity [" + x + "/s]"};
  names.cycle_inputs = {"command_velocity [" + x + "/s]", "command_acceleration [" + x + "/s^2]",
                        "command_jerk [" + x + "/s^3]", "disturbance [" + x + "/s^2]",
                        "disturbance_rate [" + x + "/s^3]"};
  return names;
}

std::vector<MatVariable> matrices_of(const ModelRecord& record, double position) {
  const Model& model = record.model;
  const Effect* two_mass = two_mass_of(model);
  const StateSpace s =
      two_mass != nullptr
          ? state_space(model.loop, two_mass_parameters(*two_mass), model.sample_time_s)
          : state_space(at_position(model.loop, position), model.sample_time_s);
  const Names names = names_of(record);
  const auto number = [](double value) { return Eigen::MatrixXd::Constant(1, 1, value); };
  return {{"A", s.a},
          {"B", s.b},
          {"C", s.c},
          {"D", s.d},
          {"Phi", s.phi},
          {"Gamma", s.g},
          {"sample_time_s", number(model.sample_time_s)},
          {"command_delay_s", number(model.command_delay_s())},
          {"axis_position", number(position)},
          {"states", names.states},
          {"inputs", names.inputs},
          {"outputs", names.outputs},
          {"cycle_inputs", names.cycle_inputs},
          {"axis", record.axis},
          {"model_version", number(record.version)}};
}

json unit_json(const FmuUnit& unit, const std::filesystem::path& file) {
  json variables = json::array();
  for (const UnitVariable& v : unit.description.variables)
    variables.push_back({{"name", v.name},
                         {"value_reference", v.reference},
                         {"causality", v.causality},
                         {"unit", v.unit}});
  return {{"file", file.string()},
          {"model_identifier", unit.description.identifier},
          {"guid", unit.description.guid},
          {"bytes", unit.zip.size()},
          {"variables", variables}};
}

void run(const ExportArguments& arguments) {
  if (arguments.unit.empty() && arguments.matrices.empty())
    throw UsageError("nothing to write: give --fmu OUT.fmu, --mat OUT.mat or both");
  if (is_stdout(arguments.matrices))
    throw UsageError("a MATLAB file cannot go to standard output; name a file");
  const ModelRecord record = read_model(arguments.model);
  std::FILE* people = people_beside({arguments.unit, arguments.matrices, arguments.result});
  json result{{"schema", kExportSchema},
              {"axis", record.axis},
              {"kind", record.rotary ? "rotary" : "linear"},
              {"model_version", record.version},
              {"sample_time_s", record.model.sample_time_s}};
  const std::string rate = text("axis %s, %s, sample time %.9g s", record.axis.c_str(),
                                structure_text(record.model).c_str(), record.model.sample_time_s);
  if (!arguments.unit.empty()) {
    std::vector<std::string> about = parameter_lines(record);
    for (std::string& line : fit_lines(record, Times::kOfRecording))
      about.push_back(std::move(line));
    const FmuUnit unit = make_unit(record, about);
    write_result(arguments.unit, unit.zip);
    say(people, "unit        " + rate);
    for (const UnitVariable& v : unit.description.variables) {
      if (v.causality != "parameter")
        say(people, text("%-11s %s [%s]", v.causality.c_str(), v.name.c_str(), v.unit.c_str()));
    }
    say(people,
        text("parameters  %td",
             std::count_if(unit.description.variables.begin(), unit.description.variables.end(),
                           [](const UnitVariable& v) { return v.causality == "parameter"; })));
    result["unit"] = unit_json(unit, arguments.unit);
  }
  if (!arguments.matrices.empty()) {
    const Travel& travel = record.model.loop.travel;
    const bool given = std::isfinite(arguments.position);
    const double position = given ? arguments.position : 0.5 * (travel.from + travel.to);
    write_mat(arguments.matrices, matrices_of(record, position));
    say(people, "matrices    " + text("axis %s, the loop of order %d, sample time %.9g s",
                                      record.axis.c_str(), record.model.loop.order,
                                      record.model.sample_time_s));
    const auto& modes = record.model.loop.modes;
    if (std::any_of(modes.begin(), modes.end(), [](const Mode& mode) { return mode.moves(); }))
      say(people, text("note: its modes move with position; the matrices are those at %g %s%s",
                       position, record.rotary ? "rad" : "m",
                       given ? "" : ", the middle of the travel; --at selects another position"));
    Model left_out = record.model;
    std::erase_if(left_out.effects, [](const Effect& effect) { return acts_on_axis(effect.kind); });
    if (!left_out.effects.empty())
      say(people, "note: the matrices contain the linear loop only, without: " +
                      structure_text(left_out).substr(std::string("order 3: ").size()));
    if (two_mass_of(record.model) != nullptr)
      say(people, std::string("note: the matrices contain motor and load as two masses") +
                      (plays(record.model) ? ", without the play between them" : ""));
    const Names names = names_of(record);
    result["matrices"] = {{"file", arguments.matrices.string()},
                          {"axis_position", position},
                          {"states", names.states},
                          {"inputs", names.inputs},
                          {"outputs", names.outputs},
                          {"cycle_inputs", names.cycle_inputs}};
  }
  if (!arguments.result.empty()) write_json(arguments.result, result);
  say_written(people, {arguments.unit, arguments.matrices, arguments.result});
}

}  // namespace

Command add_export(CLI::App& app) {
  const auto arguments = std::make_shared<ExportArguments>();
  OptionTable command(app, "export",
                      "Exports a model to other programs: as an FMI 2.0 unit, "
                      "or as matrices for MATLAB and Octave.");
  command.option("MODEL", arguments->model, "model file (servotwin.model/1)").required();
  command
      .option("--fmu", arguments->unit,
              "write an FMI 2.0 unit for co-simulation to this file; - is standard output")
      .takes("OUT.fmu");
  command
      .option("--mat", arguments->matrices,
              "write the loop to this file as matrices, continuous and discretised (MATLAB v5)")
      .takes("OUT.mat");
  command
      .option("--at", arguments->position,
              "axis position of the matrices [m | rad], for modes that vary with position "
              "(default: middle of the travel)")
      .takes("POSITION");
  command
      .option("--json", arguments->result,
              "write a description of the export to this file (servotwin.export/1); - is "
              "standard output")
      .takes("OUT");
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
