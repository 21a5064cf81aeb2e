// servotwin characterize: friction from the motor's torque (paper 001).
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/common/command.h"
#include "cli/common/force_text.h"
#include "cli/common/model_text.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "diagnosis/report/plot.h"
#include "drivers/common/text.h"
#include "identification/loop/identify.h"
#include "identification/loop/joint.h"
#include "identification/model/json_number.h"
#include "identification/torque/friction_from_torque.h"
#include "identification/torque/hysteresis.h"
#include "twin/shown_units.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

constexpr int kCurvePoints = 200;
constexpr double kMinMass_deviations = 3.0;  // of the moved mass, before forces are divided by it

struct CharacterizeArguments {
  AxisOptions input;
  std::filesystem::path model, result, plot;
  std::string method = "ramps";
  std::vector<std::string> frictions = {"lugre", "stribeck"};
  double centre_mm = 0.0, band_mm = 0.0, lead_mm = 0.0;
  double training_share = 0.6, bandwidth_hz = 40.0;
  double travel_um = 200.0;
  bool invert = false;
};

std::string effects_text(const ForceStructure& structure) {
  std::string out;
  for (const std::size_t kind : structure.effects)
    out += (out.empty() ? "" : " + ") + std::string(identity_of(kind).id);
  return out;
}

void say_trials(std::FILE* people, const std::vector<FrictionTrial>& trials,
                const ForceUnit& unit) {
  say(people,
      text("tried       held-out data: RMS, MAX [%s], share of the torque", unit.name.c_str()));
  for (const FrictionTrial& trial : trials) {
    say(people, text("  %-10s%9.4g %9.4g %8.3f %%  ", trial.chosen ? "->" : "",
                     trial.held_out.rms / unit.scale, trial.held_out.max / unit.scale,
                     100.0 * trial.held_out.relative) +
                    effects_text(trial.structure));
  }
}

json trials_json(const std::vector<FrictionTrial>& trials, const ForceUnit& unit) {
  json out = json::array();
  for (const FrictionTrial& trial : trials) {
    json one = force_json(trial.fit, trial.structure.mass, unit);
    one["training"] = {{"rms", trial.fit.error.rms / unit.scale},
                       {"relative", trial.fit.error.relative}};
    one["held_out"] = {{"rms", trial.held_out.rms / unit.scale},
                       {"max", trial.held_out.max / unit.scale},
                       {"relative", trial.held_out.relative}};
    one["chosen"] = trial.chosen;
    out.push_back(one);
  }
  return out;
}

const FrictionTrial& chosen(const std::vector<FrictionTrial>& trials) {
  return *std::find_if(trials.begin(), trials.end(), [](const auto& t) { return t.chosen; });
}

/// The speeds between the slowest and the fastest, evenly in their logarithm.
std::vector<double> speeds_between(double slowest, double fastest) {
  std::vector<double> out;
  for (int i = 0; i < kCurvePoints; ++i)
    out.push_back(slowest * std::pow(fastest / slowest, i / (kCurvePoints - 1.0)));
  return out;
}

/// Velocity-torque pairs with the fits, both directions over speed.
std::string ramps_plot(const std::vector<Ramp>& ramps, const std::vector<FrictionTrial>& trials,
                       const ForceUnit& unit) {
  std::vector<PlotPanel> panels;
  double slowest = 1e300, fastest = 0.0;
  for (const Ramp& ramp : ramps) {
    slowest = std::min(slowest, std::abs(ramp.velocity));
    fastest = std::max(fastest, std::abs(ramp.velocity));
  }
  for (const double sign : {1.0, -1.0}) {
    PlotPanel panel;
    panel.title = sign > 0.0 ? "positive direction" : "negative direction";
    panel.x_label = text("speed [%s/s]", milli(unit.rotary));
    panel.y_label = "friction [" + unit.name + "]";
    panel.logarithmic_x = true;
    PlotSeries steady{"steady ramps", {}, {}, false, "#555555"};
    PlotSeries jumping{"with stick-slip", {}, {}, false, "#e0a030"};
    for (const Ramp& ramp : ramps) {
      if (ramp.velocity * sign < 0.0) continue;
      PlotSeries& series = ramp.stick_slip ? jumping : steady;
      series.x.push_back(std::abs(ramp.velocity) / kMilli);
      series.y.push_back(sign * ramp.torque / unit.scale);
    }
    panel.series = {steady};
    if (!jumping.x.empty()) panel.series.push_back(jumping);
    for (const FrictionTrial& trial : trials) {
      PlotSeries series{effects_text(trial.structure), {}, {}, true, ""};
      for (const double speed : speeds_between(slowest, fastest)) {
        series.x.push_back(speed / kMilli);
        series.y.push_back(sign * steady_force(trial.fit.model, sign * speed) / unit.scale);
      }
      panel.series.push_back(std::move(series));
    }
    panels.push_back(std::move(panel));
  }
  return plot_svg(panels);
}

/// Replaces the friction of a model by that of a force model, divided by the moved mass. The
/// viscous share is not added: the loop was identified with it, so its poles contain it.
void add_friction(ModelRecord& record, const ForceFit& found, double mass) {
  auto replaced = friction_kinds();
  const auto replace = [&](std::size_t kind) { replaced.push_back(kind); };
  replace(kind_of<FrictionMap>());
  record.effect_deviations.resize(record.model.effects.size());
  for (const Effect& effect : found.model.effects) {
    replace(effect.kind);
    if (effect.kind == kind_of<FrictionMap>()) {
      throw std::runtime_error(
          "friction_map cannot be put into a model: its viscous share, which the poles contain, is "
          "not known; the file is unchanged");
    }
    // Different levels of the two directions contain a constant force.
    if (effect.kind == kind_of<Stribeck>() || effect.kind == kind_of<ModifiedStribeck>() ||
        effect.kind == kind_of<AsymmetricFriction>())
      replace(kind_of<ConstantForce>());
  }
  std::vector<Effect> effects;
  std::vector<EffectDeviations> deviations;
  for (std::size_t i = 0; i < record.model.effects.size(); ++i) {
    const Effect& effect = record.model.effects[i];
    if (std::find(replaced.begin(), replaced.end(), effect.kind) != replaced.end()) continue;
    effects.push_back(effect);
    deviations.push_back(record.effect_deviations[i]);
  }
  for (std::size_t i = 0; i < found.model.effects.size(); ++i) {
    Effect effect = found.model.effects[i];
    EffectDeviations sd = found.deviations[i];
    const auto coefficients = coefficients_of(effect.kind);
    for (std::size_t c = 0; c < coefficients.size(); ++c) {
      effect.coefficient[c] /= mass;
      sd.coefficient[c] /= mass;
    }
    if (effect.kind == kind_of<Stribeck>() || effect.kind == kind_of<ModifiedStribeck>())
      effect.coefficient[5] -= effect.coefficient[4];  // viscous_minus: beyond viscous_plus
    for (std::size_t c = 0; c < coefficients.size(); ++c) {
      if (!coefficients[c].with_free_loop) effect.coefficient[c] = 0.0;
    }
    effects.push_back(effect);
    deviations.push_back(sd);
  }
  record.model.effects = std::move(effects);
  record.effect_deviations = std::move(deviations);
}

/// The model with its new friction must predict this recording better than the file does.
void require_better(ModelRecord& record, const std::filesystem::path& file,
                    const SegmentedAxis& axis, std::FILE* people) {
  if (const std::string why = why_invalid(record.model); !why.empty())
    throw std::runtime_error(file.string() + ": " + why + ". The file is unchanged");
  const ModelRecord before = read_model(file);
  const ErrorFigures had = judge(model_at(before, axis.sample_time_s, people), axis.segments),
                     has = judge(model_at(record, axis.sample_time_s, people), axis.segments);
  say(people, "old model   " + figures_text(had, axis.rotary) + "   on this recording");
  say(people, "new model   " + figures_text(has, axis.rotary));
  if (!(has.rms < had.rms)) {
    throw std::runtime_error(file.string() +
                             ": with this friction the model predicts worse, because its loop was "
                             "identified without it and compensates for it; identify both together "
                             "with 'servotwin identify'. The file is unchanged");
  }
  record.training = record.holdout = {};  // they belong to the replaced friction
  record.noise_floor = {};
}

struct Characterized {
  ForceFit fit;
  bool with_mass = false;
  double mass = kAbsent, mass_deviation = kAbsent;
  json result = json::object();
  std::string plot;
};

Characterized on_ramps(const CharacterizeArguments& arguments, const SegmentedAxis& axis,
                       const ForceUnit& unit, std::FILE* people) {
  RampOptions options;
  options.centre = arguments.centre_mm * kMilli;
  if (arguments.band_mm > 0.0) options.band = arguments.band_mm * kMilli;
  const std::vector<Ramp> ramps = ramps_of(axis.segments, options);
  if (ramps.empty()) {
    throw std::runtime_error(axis.source +
                             ": no ramp of constant commanded velocity with torque in it; record "
                             "the motion of 'servotwin motion-law', or use --method motion");
  }
  double slowest = 1e300, fastest = 0.0;
  for (const Ramp& ramp : ramps) {
    slowest = std::min(slowest, std::abs(ramp.velocity));
    fastest = std::max(fastest, std::abs(ramp.velocity));
  }
  say(people, text("ramps       %zu at %.3g to %.4g %s/s, averaged %s", ramps.size(),
                   slowest / kMilli, fastest / kMilli, milli(unit.rotary),
                   options.band ? "within the band" : "over their middle"));
  const auto jumping = static_cast<std::size_t>(
      std::count_if(ramps.begin(), ramps.end(), [](const Ramp& r) { return r.stick_slip; }));
  const auto unjudged =
      std::count_if(ramps.begin(), ramps.end(), [](const Ramp& r) { return !r.judged; });
  if (unjudged > 0) {
    say(people,
        text("stick-slip  not checked on %td ramps: they are too short for the encoder's step",
             unjudged));
  }
  require_resisting(ramps, axis.source);
  if (const double below = stick_slip_below(ramps); below > 0.0) {
    say(people, "stick-slip  on " + counted(jumping, "ramp") +
                    text(", up to %.3g %s/s: the mean torque there is not the friction at that "
                         "speed; stribeck is fitted without it",
                         below / kMilli, milli(unit.rotary)));
  } else {
    say(people, unjudged > 0 ? "            none on the other ramps"
                             : "stick-slip  none: every ramp moves steadily");
  }
  const std::vector<FrictionTrial> trials = compare_on_ramps(ramps);
  say_trials(people, trials, unit);
  Characterized out;
  out.fit = chosen(trials).fit;
  // The same recording also contains accelerations, which show the moved mass.
  const ForceStructure structure{true, chosen(trials).structure.effects};
  ForceFitOptions held;
  held.shapes.emplace();
  held.least_speed = slowest;
  for (const Effect& effect : out.fit.model.effects) {
    held.shapes->insert(
        held.shapes->end(), effect.shape.begin(),
        effect.shape.begin() + static_cast<std::ptrdiff_t>(shapes_of(effect.kind).size()));
  }
  if (const auto moved =
          fit_force(ForceData::of_motion(axis.segments, arguments.bandwidth_hz), structure, held)) {
    out.mass = moved->model.mass;
    out.mass_deviation = moved->mass_deviation;
    say(people, text("moved mass  %.4g +- %.2g %s, from the accelerations", out.mass / unit.scale,
                     moved->mass_deviation / unit.scale, unit.of_mass().c_str()));
  }
  out.result["trials"] = trials_json(trials, unit);
  json pairs = json::array();
  for (const Ramp& ramp : ramps) {
    pairs.push_back({{"velocity", ramp.velocity},
                     {"torque", ramp.torque / unit.scale},
                     {"sd", number_or_null(ramp.torque_deviation / unit.scale)},
                     {"begin_s", ramp.begin_s},
                     {"end_s", ramp.end_s},
                     {"stick_slip", ramp.stick_slip}});
  }
  out.result["ramps"] = pairs;
  out.result["stick_slip_below"] = stick_slip_below(ramps);
  if (!arguments.plot.empty()) out.plot = ramps_plot(ramps, trials, unit);
  return out;
}

Characterized on_motion(const CharacterizeArguments& arguments, const SegmentedAxis& axis,
                        const ForceUnit& unit, std::FILE* people) {
  std::vector<std::size_t> kinds;
  for (const std::string& id : arguments.frictions) kinds.push_back(kind_of(id));
  const std::vector<FrictionTrial> trials =
      compare_on_motion(axis.segments, kinds, arguments.training_share, arguments.bandwidth_hz);
  say_trials(people, trials, unit);
  Characterized out;
  out.fit = chosen(trials).fit;
  out.with_mass = true;
  out.mass = out.fit.model.mass;
  out.mass_deviation = out.fit.mass_deviation;
  require_mass(out.fit, axis.source);
  out.result["trials"] = trials_json(trials, unit);
  if (!arguments.plot.empty()) {
    const ForceData all = ForceData::of_motion(axis.segments, arguments.bandwidth_hz);
    const Eigen::VectorXd modelled = force_of(out.fit.model, all);
    PlotSeries measured{"measured", {}, {}, true, ""},
        fitted{effects_text(chosen(trials).structure), {}, {}, true, ""},
        left{"measured - fitted", {}, {}, true, ""};
    for (Eigen::Index k = 0; k < all.rows(); ++k) {
      const double t = all.time()(k);
      if (k > 0 && t - all.time()(k - 1) > 1.5 * all.step_s()) {
        for (PlotSeries* series : {&measured, &fitted, &left}) {
          series->x.push_back(t);
          series->y.push_back(kAbsent);  // a gap
        }
      }
      for (PlotSeries* series : {&measured, &fitted, &left}) series->x.push_back(t);
      measured.y.push_back(all.force()(k) / unit.scale);
      fitted.y.push_back(modelled(k) / unit.scale);
      left.y.push_back((all.force()(k) - modelled(k)) / unit.scale);
    }
    const std::string label = "[" + unit.name + "]";
    out.plot = plot_svg({{"motor torque", "time [s]", label, false, {measured, fitted}},
                         {"residual", "time [s]", label, false, {left}}});
  }
  return out;
}

Characterized on_reversals(const CharacterizeArguments& arguments, const SegmentedAxis& axis,
                           const ForceUnit& unit, std::FILE* people) {
  // The inertia is fitted first: its share of the torque is small at a slow reversal, but can be
  // removed.
  const auto moved = fit_force(ForceData::of_motion(axis.segments, arguments.bandwidth_hz),
                               {true, {kind_of<Presliding>(), kind_of<ConstantForce>()}});
  if (!moved) throw std::runtime_error(axis.source + ": no finite fit of the moved mass");
  require_mass(*moved, axis.source);
  const double mass = moved->model.mass;
  const VirginCurve curve = virgin_curve_of(axis.segments, arguments.travel_um * kMicro, mass);
  const auto fit = fit_force(ForceData::of_virgin_curve(curve.displacement, curve.force),
                             {false, {kind_of<Presliding>()}});
  if (!fit) throw std::runtime_error(axis.source + ": the virgin curve could not be fitted");
  const char* small = micro(unit.rotary);
  say(people, text("virgin curve from %d reversal branches, halved: %.4g %s after %.4g %s",
                   curve.branches, curve.force(curve.force.size() - 1) / unit.scale,
                   unit.name.c_str(), curve.displacement(curve.force.size() - 1) / kMicro, small));
  say(people,
      text("presliding  fits it to %.3g %s RMS", fit->error.rms / unit.scale, unit.name.c_str()));
  Characterized out;
  out.fit = *fit;
  out.mass = mass;
  out.mass_deviation = moved->mass_deviation;
  const double longest = curve.displacement(curve.displacement.size() - 1);
  if (out.fit.model.effects[0].shape[0] > longest) {
    say(people, text("note        the breakaway displacement is larger than the evaluated %.4g %s: "
                     "use a larger --travel",
                     longest / kMicro, small));
  }
  json points = json::array();
  for (Eigen::Index k = 0; k < curve.force.size(); ++k) {
    points.push_back({{"displacement", curve.displacement(k)},
                      {"force", curve.force(k) / unit.scale},
                      {"sd", curve.deviation(k) / unit.scale}});
  }
  out.result["virgin_curve"] = points;
  if (!arguments.plot.empty()) {
    PlotSeries measured{"halved branches", {}, {}, false, ""},
        fitted{"presliding", {}, {}, true, ""};
    const ForceData data = ForceData::of_virgin_curve(curve.displacement, curve.force);
    const Eigen::VectorXd modelled = force_of(fit->model, data);
    for (Eigen::Index k = 0; k < curve.force.size(); ++k) {
      for (PlotSeries* series : {&measured, &fitted})
        series->x.push_back(curve.displacement(k) / kMicro);
      measured.y.push_back(curve.force(k) / unit.scale);
      fitted.y.push_back(modelled(k) / unit.scale);
    }
    out.plot = plot_svg({{"virgin curve",
                          std::string("displacement [") + small + "]",
                          "force [" + unit.name + "]",
                          false,
                          {measured, fitted}}});
  }
  return out;
}

void run(const CharacterizeArguments& arguments) {
  std::FILE* people = people_beside({arguments.result, arguments.plot});
  SegmentedAxis axis = arguments.input.read(people);
  require_torque(axis, arguments.invert);
  require_motion(axis);
  if (arguments.lead_mm > 0.0 && (axis.rotary || axis.torque_unit != "Nm")) {
    throw UsageError("--lead needs a linear axis whose torque is in Nm");
  }
  ModelRecord record;
  if (!arguments.model.empty()) {
    record = read_model_for(arguments.model, axis.axis, axis.rotary);
    if (record.axis != axis.axis) {
      throw std::runtime_error(arguments.model.string() + " is the model of axis " + record.axis +
                               ", not of " + axis.axis);
    }
  }
  const ForceUnit unit = force_unit(axis.torque_unit, axis.rotary, arguments.lead_mm * kMilli);
  Characterized found;
  {
    const Progress progress("characterizing " + axis.axis);
    found = arguments.method == "ramps"    ? on_ramps(arguments, axis, unit, people)
            : arguments.method == "motion" ? on_motion(arguments, axis, unit, people)
                                           : on_reversals(arguments, axis, unit, people);
  }
  for (const std::string& line : force_lines(found.fit, found.with_mass, unit)) say(people, line);
  if (const auto open = undetermined(found.fit); !open.empty()) {
    say(people,
        "note        not determined by these data (+- beyond the value itself): " + listed(open));
  }
  if (!arguments.model.empty()) {
    if (!(found.mass > kMinMass_deviations * found.mass_deviation)) {
      throw std::runtime_error(
          arguments.model.string() +
          ": the moved mass is not known accurately enough to divide the friction by it; the "
          "recording must contain accelerations. The file is unchanged");
    }
    add_friction(record, found.fit, found.mass);
    require_better(record, arguments.model, axis, people);
  }
  if (!arguments.plot.empty()) write_result(arguments.plot, found.plot);
  if (!arguments.result.empty()) {
    json out = force_json(found.fit, found.with_mass, unit);
    out["schema"] = "servotwin.characterization/1";
    out["axis"] = axis.axis;
    out["method"] = arguments.method;
    out["source"] = axis.source;
    if (std::isfinite(found.mass))
      out["moved_mass"] = {{"value", found.mass / unit.scale},
                           {"unit", unit.of_mass()},
                           {"sd", found.mass_deviation / unit.scale}};
    out["force_unit"] = unit.name;
    out["undetermined"] = undetermined(found.fit);
    out.update(found.result);
    write_json(arguments.result, out);
  }
  say_written(people, {arguments.plot, arguments.result});
  if (arguments.model.empty()) return;
  write_json(arguments.model, to_json(record));
  say(people, "written     " + arguments.model.string() +
                  ": its friction is replaced; viscous friction stays in the poles");
}

}  // namespace

Command add_characterize(CLI::App& app) {
  const auto arguments = std::make_shared<CharacterizeArguments>();
  OptionTable command(app, "characterize",
                      "Identifies the friction of an axis from the motor's torque.");
  arguments->input.declare(command);
  command
      .option(
          "--method", arguments->method,
          "ramps (default): mean torque at constant velocities, from a recording of 'motion-law'; "
          "motion: friction and inertia from any motion; reversals: the virgin "
          "curve from slow hysteresis")
      .one_of({"ramps", "motion", "reversals"})
      .takes("METHOD");
  command.option("--model", arguments->model, "replace the friction in this model file")
      .takes("M.json");
  command
      .option("--json", arguments->result,
              "write the complete result to this file; - is standard output")
      .takes("OUT");
  command.option("--plot", arguments->plot, "write a plot of data and fits to this file (SVG)")
      .takes("OUT.svg");
  command
      .option("--lead", arguments->lead_mm,
              "lead of the screw [mm]: print torques in Nm as forces in N")
      .takes("MM")
      .positive();
  command
      .option("--band", arguments->band_mm,
              "ramps: average within this band [mm | mrad] (default: the middle of every ramp)")
      .takes("MM")
      .positive();
  command.flag("--invert-torque", arguments->invert,
               "the drive records torque with the opposite sign: invert it");
  command.option("--centre", arguments->centre_mm, "ramps: the middle of the band [mm | mrad]")
      .takes("MM");
  command
      .option("--friction", arguments->frictions,
              "motion: friction models to compare (default lugre,stribeck)")
      .comma_separated()
      .one_of(torque_frictions())
      .takes("ID,..");
  command
      .option("--training-share", arguments->training_share,
              "motion: share of the data that is fitted (default 0.6); the rest is held-out data")
      .takes("SHARE")
      .between(0.1, 0.9);
  command
      .option(
          "--bandwidth", arguments->bandwidth_hz,
          "highest frequency at which torque and model are compared [Hz] (default 40); 0: no limit")
      .takes("HZ")
      .not_negative();
  command
      .option("--travel", arguments->travel_um,
              "reversals: travel that a reversal must have on each side [um | urad] (default 200)")
      .takes("UM")
      .positive();
  // An option of another method would be ignored silently.
  const auto only = [command, arguments](const char* option, const char* method) {
    if (command.given(option) && arguments->method != method)
      throw UsageError(std::string(option) + " needs --method " + method);
  };
  return {command.app(), [arguments, only] {
            only("--friction", "motion");
            only("--training-share", "motion");
            only("--band", "ramps");
            only("--centre", "ramps");
            only("--travel", "reversals");
            run(*arguments);
          }};
}

}  // namespace servotwin::cli
