// servotwin identify: from a recording to a model file.
#include "identification/loop/identify.h"

#include <chrono>
#include <cmath>
#include <ctime>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/common/command.h"
#include "cli/common/model_text.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "cli/recording/prediction_plot.h"
#include "diagnosis/search/diagnose.h"
#include "identification/loop/identified_file.h"
#include "identification/loop/joint.h"
#include "identification/recording/excerpt.h"
#include "twin/shown_units.h"

namespace servotwin::cli {
namespace {

struct IdentifyArguments {
  AxisOptions input;
  std::filesystem::path model, result, plot;
  IdentifyOptions identify;
  bool no_pole_constraints = false;
  bool whole = false;    ///< --whole: all of a long recording
  bool details = false;  ///< --details: also the structures that were ruled out
};

double length_s(const std::vector<Segment>& segments) {
  double sum = 0.0;
  for (const Segment& one : segments) sum += one.sample_time_s * static_cast<double>(one.size());
  return sum;
}

/// Leaves the informative part of a long recording.
void use_excerpt(SegmentedAxis& axis, std::FILE* people) {
  const double all_s = length_s(axis.segments);
  std::vector<Segment> used = excerpt(axis.segments);
  const double used_s = length_s(used);
  if (!(used_s < all_s)) return;
  axis.segments = std::move(used);
  say(people, text("note: of %.0f s the most informative %.0f s are used, from all parts of the "
                   "recording; --whole uses all",
                   all_s, used_s));
}

std::string now_utc() {
  const std::time_t now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
  std::tm utc{};
  ::gmtime_r(&now, &utc);
  return text("%04d-%02d-%02dT%02d:%02d:%02dZ", utc.tm_year + 1900, utc.tm_mon + 1, utc.tm_mday,
              utc.tm_hour, utc.tm_min, utc.tm_sec);
}

/// RMS of the tracking error on the hold-out [m | rad]; NaN without one.
double tracking_rms(const ModelRecord& record, const std::vector<Segment>& segments) {
  double sum = 0.0, count = 0.0;
  for (const Segment& s : cut(segments, record.training_to_s + 1e-9, 1e300)) {
    const Eigen::ArrayXd error = s.command - s.actual;
    sum += error.square().sum();
    count += static_cast<double>(error.size());
  }
  return std::sqrt(sum / count);
}

/// It may find none.
constexpr const char* kSeekCauses = "; 'servotwin diagnose' looks for the causes of what is left";

/// Whether and for what the model can be used, in one line.
std::string verdict_text(const Identified& identified, const std::vector<Segment>& segments) {
  const ModelRecord& record = identified.record;
  if (!identified.refusals.empty()) return "must not be used, see refused";
  const double error = tracking_rms(record, segments), left = record.holdout.rms;
  // Of the squared tracking error; a loop that is right but for its friction explains more.
  constexpr double kMinExplained = 0.9;
  const double explained = 1.0 - left * left / (error * error);
  if (!std::isfinite(explained)) return "cannot be judged: no motion is held out";
  const std::string share = micro_text(left, record.rotary, 3) +
                            " RMS left of a tracking error of " +
                            micro_text(error, record.rotary, 3) + " on held-out motion";
  // Noise and rounding of the encoder, and the scatter of their estimate over a few seconds.
  constexpr double kMaxRmsOverFloor = 1.2;
  if (explained < kMinExplained && left <= kMaxRmsOverFloor * record.noise_floor.rms)
    return "as good as this encoder shows: " + share +
           ", which is the encoder's own noise: a finer encoder or a longer motion tells more";
  if (explained < kMinExplained) return "weak: " + share + kSeekCauses;
  if (!record.excitation.empty())
    return "for motion like this only: " + share +
           "; not all of the model was excited: other motion may be predicted worse, and its "
           "parameters need not be those of the axis";
  // Above it noise is less than a ninth of the squared residual.
  constexpr double kMaxRmsOverFloorOfNoise = 3.0;
  if (record.noise_floor.rms > 0.0 && left > kMaxRmsOverFloorOfNoise * record.noise_floor.rms)
    return "good for predictions: " + share + kSeekCauses;
  return "good: " + share + ", little more than the noise";
}

void say_result(std::FILE* people, const Identified& identified,
                const std::vector<Segment>& segments, bool details) {
  const ModelRecord& record = identified.record;
  if (!identified.trials.empty())
    say(people, "tried       validation RMS, within the training data");
  std::size_t hidden = 0;
  for (const StructureTrial& trial : identified.trials) {
    if (!trial.ruled_out.empty() && !trial.chosen && !details) {
      ++hidden;
      continue;
    }
    constexpr double kWidest = 1e6;  // of the column; an unstable structure leaves far more
    const double shown = 1e6 * trial.validation_rms;
    const std::string error = std::isfinite(shown) ? text(shown < kWidest ? "%9.3f %s" : "%9.2g %s",
                                                          shown, micro(record.rotary))
                                                   : "   no fit";
    say(people, text("  %s       %s  ", trial.chosen ? "->" : "  ", error.c_str()) +
                    structure_text(trial.order, trial.effects, trial.modes, trial.moving) +
                    (trial.ruled_out.empty() ? ""
                     : trial.chosen          ? "  [no other passes; " + trial.ruled_out + "]"
                                             : "  [ruled out: " + trial.ruled_out + "]"));
  }
  if (hidden > 0)
    say(people, text("               %zu more ruled out; --details tells why", hidden));
  for (const std::string& line : parameter_lines(record)) say(people, line);
  for (const std::string& line : fit_lines(record, Times::kOfRecording)) say(people, line);
  if (!identified.no_torque.empty())
    say(people, "torque      not predicted: " + identified.no_torque);
  if (record.excitation.empty()) {
    say(people,
        record.method == "full-ls"
            ? "excitation  the motion has reversals and acceleration; full LS estimates no "
              "standard deviations"
        : scatter_decides(record)
            ? "excitation  sufficient: the standard deviations of the poles and of the friction "
              "level are below half of their values"
            : "excitation  sufficient against noise; more than noise limits the accuracy, see "
              "the note");
  }
  for (const std::string& line : record.excitation) say(people, "excitation  " + line);
  if (record.method != "full-ls" && !scatter_decides(record)) {
    say(people,
        text("note        the residual is %.0f times the noise floor: effects that the model "
             "does not have shift its values, the poles as well, further than noise, and no "
             "standard deviation is given",
             record.training.rms / record.noise_floor.rms));
  }
  for (const std::string& line : identified.refusals) say(people, "refused     " + line);
  tell(people, "verdict     " + verdict_text(identified, segments));
  say(people, text("time taken  %9.3f s, %s", record.time_taken_s, record.method.c_str()));
}

void run(const IdentifyArguments& arguments) {
  std::FILE* people = people_beside({arguments.model, arguments.result, arguments.plot});
  IdentifyOptions options = arguments.identify;
  if (auto why = why_invalid(options.bounds); !why.empty()) throw UsageError(why);
  if (arguments.no_pole_constraints && options.method != Method::kFullLs) {
    throw UsageError(
        "--no-pole-constraints needs --method full-ls: the pole search needs its bounds");
  }
  if (options.friction && options.method != Method::kJoint) {
    throw UsageError(
        "--friction needs --method joint: the pole search models Coulomb friction only");
  }
  if (options.masses != Masses::kRigid && options.method != Method::kJoint)
    throw UsageError(
        "--structure two-mass and auto need --method joint: they are fitted in free simulation");
  if (options.masses != Masses::kRigid && options.modes > 0)
    throw UsageError(
        "--structure two-mass and auto take no --modes: a mode stands for the same vibration");
  if (options.method == Method::kFullLs && (options.modes > 0 || options.coupling))
    throw UsageError(
        std::string(options.modes > 0 ? "--modes" : "--coupling") +
        " is not for --method full-ls, which models one loop and Coulomb friction only");
  options.pole_constraints = !arguments.no_pole_constraints;

  SegmentedAxis axis = arguments.input.read(people, options.coupling);
  require_motion(axis);
  if (!arguments.whole) use_excerpt(axis, people);
  Identified identified;
  {
    const Progress progress("identifying " + axis.axis);
    const auto start = std::chrono::steady_clock::now();
    identified = identify(axis, options);
    identified.record.time_taken_s =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  }
  identified.record.motion = motion_range(axis.segments);
  identified.record.created = now_utc();
  identified.record.source = arguments.input.source();

  if (identified.refusals.empty() || arguments.details)
    say_result(people, identified, axis.segments, arguments.details);
  if (!arguments.result.empty()) write_json(arguments.result, to_json(identified));
  if (!identified.refusals.empty()) {
    say_written(people, {arguments.result});
    std::string why = "the model must not be used: ";
    for (std::size_t i = 0; i < identified.refusals.size(); ++i) {
      why += (i == 0 ? "" : "; ") + identified.refusals[i];
    }
    if (!arguments.model.empty()) why += "; " + arguments.model.string() + " was not written";
    throw std::runtime_error(why);
  }
  if (!arguments.plot.empty()) {
    const ModelRecord& record = identified.record;
    const std::vector<Segment> holdout = held_out(axis.segments, record.training_to_s + 1e-9);
    write_result(arguments.plot,
                 plot_rows_svg(prediction_panels(record.axis, record.rotary, record.model, holdout,
                                                 record.holdout, record.noise_floor)));
  }
  if (!arguments.model.empty()) write_json(arguments.model, to_json(identified.record));
  say_written(people, {arguments.result, arguments.plot, arguments.model});
}

/// MIN:MAX.
void add_range(OptionTable& command, const std::string& name, double& min, double& max,
               const std::string& what) {
  command
      .option_read_by(
          name,
          [&min, &max, name](const std::string& given) {
            const std::vector<double> numbers = parse_numbers(name, given, "range MIN:MAX", 2, 2);
            min = numbers[0];
            max = numbers[1];
          },
          what + text(" (default %g:%g)", min, max))
      .takes("MIN:MAX");
}

}  // namespace

Command add_identify(CLI::App& app) {
  const auto arguments = std::make_shared<IdentifyArguments>();
  arguments->identify.method = Method::kJoint;
  OptionTable command(app, "identify", "Identifies the model of an axis from a recording.");
  arguments->input.declare_several(command);
  command
      .option("--model", arguments->model,
              "write the model to this file (servotwin.model/1), unless it is refused")
      .takes("OUT.json");
  command
      .option("--json", arguments->result,
              "write the complete result to this file; - is standard output")
      .takes("OUT");
  command
      .option("--plot", arguments->plot,
              "write a plot of the held-out data, measured and predicted, to this file (SVG), "
              "unless the model is refused")
      .takes("OUT.svg");
  command
      .option_read_by(
          "--method",
          [arguments](const std::string& name) {
            arguments->identify.method = name == "full-ls" ? Method::kFullLs
                                         : name == "joint" ? Method::kJoint
                                                           : Method::kPoleSearch;
          },
          "joint (default): the loop together with the law of friction; pole-search: the loop with "
          "Coulomb friction alone, faster; full-ls: full least squares, a baseline")
      .one_of({"joint", "pole-search", "full-ls"})
      .takes("METHOD");
  std::vector<std::string> frictions;
  for (const std::size_t kind : friction_kinds()) frictions.emplace_back(identity_of(kind).id);
  command
      .option_read_by(
          "--friction",
          [arguments](const std::string& id) { arguments->identify.friction = kind_of(id); },
          "joint: use this friction model (default: the one that predicts held-out data best)")
      .one_of(frictions)
      .takes("ID");
  command
      .option_read_by(
          "--structure",
          [arguments](const std::string& name) {
            arguments->identify.masses = name == "two-mass" ? Masses::kTwo
                                         : name == "auto"   ? Masses::kChosen
                                                            : Masses::kRigid;
          },
          "joint: rigid (default); two-mass, motor and load on a spring; auto, two masses if they "
          "predict held-out data clearly better")
      .one_of({"rigid", "two-mass", "auto"})
      .takes("STRUCTURE");
  PoleBounds& bounds = arguments->identify.bounds;
  add_range(command, "--real-pole-hz", bounds.real_min_hz, bounds.real_max_hz,
            "bounds of the real pole");
  add_range(command, "--natural-frequency-hz", bounds.omega_min_hz, bounds.omega_max_hz,
            "bounds of the pole pair");
  add_range(command, "--damping", bounds.zeta_min, bounds.zeta_max,
            "bounds of the pair's damping ratio");
  command
      .option("--training-share", arguments->identify.training_share,
              "share of the data that is fitted (default 0.6, up to 0.85 where the axis hardly "
              "accelerates "
              "before); the rest is held-out data")
      .takes("SHARE")
      .between(0.1, 0.95);
  command
      .option("--order", arguments->identify.order,
              "order of the position loop, 2 or 3 (default: chosen on held-out data)")
      .takes("N")
      .one_of_numbers({2, 3});
  command
      .option("--modes", arguments->identify.modes,
              "largest number of vibration modes (default 0); a mode is added only if it "
              "lowers the held-out error")
      .takes("N")
      .between(0.0, static_cast<double>(kMaxModes));
  command.flag("--coupling", arguments->identify.coupling,
               "model the effect of another axis' acceleration on this one (--beside), if that "
               "lowers the held-out error");
  command
      .option(
          "--delay-max", arguments->identify.delay_max_s,
          "longest delay of the encoder record that is searched for [s] (default 0.02); 0: none")
      .takes("S")
      .between(0.0, 0.05);
  command.flag("--whole", arguments->whole,
               "use all of a recording of more than 240 s, and not its most informative 120 s");
  command.flag(
      "--details", arguments->details,
      "print also the structures that were ruled out, and why, and a model that is refused");
  command.flag("--no-pole-constraints", arguments->no_pole_constraints,
               "full-ls: accept any poles");
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
