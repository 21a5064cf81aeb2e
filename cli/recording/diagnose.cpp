// servotwin diagnose: what the simulation of an axis gets wrong, its causes, and what naming them
// gains.
#include "diagnosis/search/diagnose.h"
#include "diagnosis/search/extension.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>

#include "cli/common/command.h"
#include "cli/common/model_text.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "diagnosis/evidence/encoder_difference.h"
#include "diagnosis/report/cause_words.h"
#include "diagnosis/report/diagnosis_file.h"
#include "diagnosis/report/in_short.h"
#include "diagnosis/report/report.h"
#include "diagnosis/report/torque_text.h"
#include "diagnosis/search/comparison.h"
#include "diagnosis/torque/torque.h"
#include "twin/shown_units.h"

namespace servotwin::cli {
namespace {

struct DiagnoseArguments {
  AxisOptions input;
  std::filesystem::path result, report, extended, earlier;
  std::string test;  // base name of the files of the suggested test
  DiagnoseOptions options;
  bool details = false;
};

/// In alphabetical order, each once.
std::vector<std::string> known_causes() {
  std::set<std::string> out{"dropped_samples"};
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    if (!identity_of(kind).cause.empty()) out.emplace(identity_of(kind).cause);
  }
  return {out.begin(), out.end()};
}

/// For the verdict: how many causes the torque shows beside those of the loop and the limit. Not of
/// a comparison, whose causes are changes.
std::string by_torque_alone(const Diagnosis& diagnosis,
                            const std::optional<TorqueDiagnosis>& torque) {
  if (!torque || diagnosis.against_earlier) return "";
  std::set<std::string> told;
  for (const Cause& cause : diagnosis.causes) told.insert(cause.id);
  if (!diagnosis.at_limit.empty()) told.insert("torque_saturation");
  const auto count =
      std::count_if(torque->causes.begin(), torque->causes.end(),
                    [&](const TorqueCause& cause) { return told.count(cause.id) == 0; });
  if (count == 0) return "";
  return text(diagnosis.causes.empty() ? "; the torque alone shows %td cause%s"
                                       : "; the torque shows %td more cause%s",
              count, count == 1 ? "" : "s");
}

void say_diagnosis(std::FILE* people, const Diagnosis& diagnosis,
                   const std::optional<TorqueDiagnosis>& torque,
                   const std::optional<EncoderDifference>& encoders, bool details) {
  const bool rotary = diagnosis.baseline.rotary;
  say(people, "verdict     " + verdict_text(diagnosis) + by_torque_alone(diagnosis, torque));
  say(people, "baseline    " + structure_text(diagnosis.baseline.model));
  say(people, "            " + figures_text(diagnosis.baseline.holdout, rotary) +
                  text("   (hold-out, after %.4g s: not seen by the fit)",
                       diagnosis.baseline.training_to_s));
  say(people, "extended    " + figures_text(diagnosis.extended.holdout, rotary));
  say(people, "noise floor " + noise_floor_text(diagnosis.baseline.noise_floor, rotary));
  if (!diagnosis.at_limit.empty())
    say(people, "at limit    the motor is at " + diagnosis.at_limit + ": the loop is identified " +
                    (diagnosis.limit_left_out
                         ? "without them"
                         : "with them, since too little motion would be left without them"));
  for (const Cause& cause : diagnosis.causes) {
    std::string line = text("cause       %-24s ", cause.id.c_str());
    if (std::isfinite(cause.gain.before)) {
      line += text("%12.3f -> %.3f %s without and with it", 1e6 * cause.gain.before,
                   1e6 * cause.gain.after, micro(rotary));
    } else if (cause.counts.empty() && cause.moved.empty()) {
      line += "without it the simulation diverges";
    }
    if (std::isfinite(cause.gain.low))
      line += text(" (gain %.2g to %.2g %s)", 1e6 * cause.gain.low, 1e6 * cause.gain.high,
                   micro(rotary));
    if (cause.place == kNoEffect && cause.moved.empty()) {
      line += std::string(std::isfinite(cause.gain.before) ? ", " : "") + "counted, not inferred";
    } else {
      line += text(", confidence %.0f %%", 100.0 * cause.confidence);
    }
    say(people, line);
    say(people, "              " + cause_text(diagnosis, cause));
    if (const std::string also = torque ? torque_beside(*torque, cause.id) : ""; !also.empty())
      say(people, "              " + also);
    if (const std::string also = encoders ? encoders_beside(*encoders, cause.id) : "";
        !also.empty())
      say(people, "              " + also);
    if (worth_a_repair(cause.gain)) {
      std::string repair = text("tracking error %.4g -> %.4g %s RMS", 1e6 * cause.gain.tracking_now,
                                1e6 * cause.gain.tracking_repaired, micro(rotary));
      if (std::isfinite(cause.gain.contour_repaired))
        repair = text("contour error %.4g -> %.4g um RMS, ", 1e6 * cause.gain.contour_now,
                      1e6 * cause.gain.contour_repaired) +
                 repair;
      repair = "repaired: " + repair;
      say(people, "              " + repair);
    }
    for (const std::string& rival : cause.ambiguous_with)
      say(people, "              not distinguishable from " + rival + " with this recording");
    if (const std::string advice = advice_for(diagnosis, cause); !advice.empty())
      say(people, "              check " + advice);
    say(people, "              see " + page_to_read(cause.id));
  }
  for (const Cause& cause : diagnosis.suspected) {
    std::string rivals;
    for (const std::string& rival : cause.ambiguous_with)
      rivals += (rivals.empty() ? "; this recording does not tell it from " : " or ") + rival;
    const std::string why =
        cause.confidence < kMinConfidenceToName ? "too low to name it as a cause"
        : cause.doubt == CauseDoubt::kParameters
            ? "but " + cause.at_end
            : "but its gain on held-out data may be zero, or is within the noise";
    say(people,
        text("suspected   %-24s confidence %.0f %%, ", cause.id.c_str(), 100.0 * cause.confidence) +
            why + rivals);
    say(people, "              " + cause_text(diagnosis, cause));
  }
  if (const std::string term = not_understood_text(diagnosis); !term.empty())
    say(people, "not known   " + term + ": it improves the prediction, but names no cause");
  if (details) {
    for (const std::string& step : diagnosis.steps) say(people, "search      " + step);
  }
  for (const RegimeShare& share : diagnosis.regimes) {
    if (share.samples == 0) continue;
    say(people, text("residual    %-14s %8.3f %s RMS %8.2f MAX, %4.1f %% of the squared error in "
                     "%4.1f %% of the time",
                     std::string(name_of(share.regime)).c_str(), 1e6 * share.rms, micro(rotary),
                     1e6 * share.max, 100.0 * share.share, 100.0 * share.time_share));
  }
  for (const std::string& line : left_lines(diagnosis)) say(people, "residual    " + line);
  if (encoders) say(people, "encoders    " + plain_text(*encoders));
  for (const NotObservable& one : diagnosis.not_observable)
    say(people, text("not observable here: %-24s ", one.id.c_str()) + one.why);
  if (diagnosis.suggested_test) {
    // One sentence per line.
    std::string words = diagnosis.suggested_test->words;
    for (std::size_t at = 0; (at = words.find(". ", at)) != std::string::npos; at += 14)
      words.replace(at, 2, ".\n            ");
    say(people, "test        " + words);
  }
}

/// Writes BASE.csv and BASE.nc and returns their names; none if no motion is suggested.
std::vector<std::string> write_test(const std::string& base, const Diagnosis& diagnosis, double h,
                                    std::FILE* people) {
  if (!diagnosis.suggested_test || !diagnosis.suggested_test->motion) {
    say(people,
        diagnosis.suggested_test
            ? "test        no test motion can decide: no file is written"
            : "test        none is needed: no cause found in the position loop is in doubt");
    return {};
  }
  const TestMotion& motion = *diagnosis.suggested_test->motion;
  const std::string& axis = diagnosis.baseline.axis;
  const bool rotary = diagnosis.baseline.rotary;
  const Eigen::ArrayXd command = motion.command(h);
  Column time{"time[s]", {}}, path{axis + (rotary ? ".command[rad]" : ".command[mm]"), {}};
  for (Eigen::Index i = 0; i < command.size(); ++i) {
    constexpr double kDigits = 1e9;  // picometres
    time.values.push_back(std::round(kDigits * h * static_cast<double>(i)) / kDigits);
    path.values.push_back(std::round(kDigits * (rotary ? 1.0 : 1e3) * command(i)) / kDigits);
  }
  write_result(base + ".csv", csv({time, path}));
  write_result(base + ".nc", gcode(motion, axis, rotary));
  say(people, "written     " + base + ".csv, " + base +
                  ".nc (accelerations are comments in it: set them in the control)");
  return {base + ".csv", base + ".nc"};
}

/// Diagnoses the torque alone; `reason` says why the position loop cannot be diagnosed.
void run_on_torque(const DiagnoseArguments& arguments, const SegmentedAxis& axis, bool commanded,
                   const std::string& reason, std::FILE* people) {
  if (!arguments.extended.empty())
    throw std::runtime_error("--extended-model: there is no model of the position loop: " + reason);
  const TorqueDiagnosis torque = diagnose_torque(axis, arguments.options, commanded);
  say(people, "torque      diagnosed alone: " + reason);
  for (const std::string& line : torque_lines(torque, arguments.details)) say(people, line);
  const std::optional<EncoderDifference> encoders = encoder_difference(axis);
  if (encoders) say(people, "encoders    " + plain_text(*encoders));
  if (!arguments.result.empty()) {
    nlohmann::json result = torque_alone(torque, reason);
    result["in_short"] = in_short(torque, reason);
    if (encoders) result["encoder_difference"] = to_json(*encoders);
    write_json(arguments.result, result);
  }
  if (!arguments.report.empty())
    write_result(arguments.report, torque_page(torque, axis.source, reason));
  say_written(people, {arguments.result, arguments.report});
  say(people, "");
  for (const std::string& sentences : in_short(torque, reason)) tell(people, sentences);
}

/// Nothing if there is no torque or too little of it; the latter is printed.
std::optional<TorqueDiagnosis> torque_of(const SegmentedAxis& axis,
                                         const DiagnoseArguments& arguments, std::FILE* people) {
  if (!has_torque(axis)) return std::nullopt;
  try {
    return diagnose_torque(axis, arguments.options);
  } catch (const std::runtime_error& error) {
    say(people, std::string("torque      not diagnosed: ") + error.what());
    return std::nullopt;
  }
}

void run(const DiagnoseArguments& arguments) {
  std::FILE* people = people_beside({arguments.result, arguments.report, arguments.extended});
  Recording recording = arguments.input.recording.read(people, arguments.input.axis);
  const std::string name = axis_of(recording, arguments.input.axis);
  const bool commanded = !without_command(recording, name);
  std::string beside = arguments.earlier.empty() ? "" : read_model(arguments.earlier).neighbour;
  const std::string& given = arguments.input.beside;
  const bool coupled = !beside.empty();
  if (coupled && !given.empty() && given != beside)
    throw std::runtime_error("--beside " + given + ": the earlier model is coupled to axis " +
                             beside);
  if (!coupled && commanded && !arguments.options.leaves_out("cross_coupling"))
    beside = arguments.input.acting_on(recording, name, people);
  else if (!coupled)
    beside = given;
  SegmentedAxis axis = segmented(recording, name, people, beside);
  arguments.input.require_beside(axis);
  if (coupled && axis.neighbour != beside)
    throw std::runtime_error(axis.source + ": the earlier model is coupled to axis " + beside +
                             ", whose command the recording does not have at the same times");
  if (coupled && coupled_by_motion(read_model(arguments.earlier).model) &&
      axis.segments.front().neighbour_motion.size() == 0)
    throw std::runtime_error(axis.source + ": the earlier model contains the motion of axis " +
                             beside + ", whose encoder the recording does not have");
  arguments.input.read_more(axis, people);
  if (!commanded) {
    run_on_torque(arguments, axis, false, "the recording has position and torque, but no command",
                  people);
    return;
  }
  Diagnosis diagnosis;
  try {
    Progress progress("diagnosing " + axis.axis);
    DiagnoseOptions options = arguments.options;
    options.progress = [&](std::string_view what) {
      const std::size_t kind = kind_of(what);
      progress.trying(kind < kEffectKinds && !cause_of(kind).empty() ? plain_name(cause_of(kind))
                                                                     : std::string(what));
    };
    diagnosis = arguments.earlier.empty() ? diagnose(axis, options)
                                          : compare(axis, read_model(arguments.earlier), options);
  } catch (const UnusableRecording&) {
    throw;  // what is wrong with the motion is wrong for the torque
  } catch (const std::runtime_error& error) {
    if (!has_torque(axis) || !arguments.earlier.empty()) throw;
    const std::string reason = error.what();
    try {
      run_on_torque(arguments, axis, true, reason, people);
    } catch (const std::runtime_error& also) {
      throw std::runtime_error(reason + "; a diagnosis by torque fails too: " + also.what());
    }
    return;
  }
  std::optional<TorqueDiagnosis> torque = torque_of(axis, arguments, people);
  if (torque) heed(*torque, diagnosis);
  diagnosis.baseline.source = diagnosis.extended.source = arguments.input.source();
  const std::optional<EncoderDifference> encoders = encoder_difference(axis);
  say_diagnosis(people, diagnosis, torque, encoders, arguments.details);
  if (torque) {
    std::vector<std::string> told;
    for (const Cause& cause : diagnosis.causes) told.push_back(cause.id);
    for (const std::string& line : torque_lines(*torque, arguments.details, told))
      say(people, line);
  }
  if (!arguments.extended.empty()) write_json(arguments.extended, to_json(diagnosis.extended));
  std::vector<std::string> test;
  if (!arguments.test.empty())
    test = write_test(arguments.test, diagnosis, axis.sample_time_s, people);
  if (!arguments.result.empty()) {
    nlohmann::json result = to_json(diagnosis, arguments.extended.string());
    if (!test.empty()) result["suggested_test_files"] = test;
    if (torque) add_torque(result, *torque);
    result["in_short"] = in_short(diagnosis, torque);
    if (encoders) result["encoder_difference"] = to_json(*encoders);
    write_json(arguments.result, result);
  }
  if (!arguments.report.empty())
    write_result(arguments.report,
                 report_html(diagnosis, axis.segments, axis.source, torque, encoders));
  say_written(people, {arguments.extended, arguments.result, arguments.report});
  say(people, "");
  for (const std::string& sentences : in_short(diagnosis, torque)) tell(people, sentences);
  // What was mended before is no part of the diagnosis, but it is of the axis.
  for (const std::string& note : recording.notes) {
    if (note.starts_with(axis.axis + ": ")) tell(people, "Before the diagnosis: " + note + ".");
  }
}

}  // namespace

Command add_diagnose(CLI::App& app) {
  const auto arguments = std::make_shared<DiagnoseArguments>();
  OptionTable command(
      app, "diagnose",
      "Diagnoses an axis: what the simulation gets wrong, and which physical causes explain it.");
  arguments->input.declare_several(command);
  command
      .option("--model", arguments->earlier,
              "earlier model of this axis: diagnose what has changed since it was identified")
      .takes("M.json");
  command
      .option("--json", arguments->result, "write the diagnosis to this file; - is standard output")
      .takes("OUT.json");
  command.option("--report", arguments->report, "write a report for people to this file")
      .takes("OUT.html");
  command
      .option("--extended-model", arguments->extended,
              "write the model with all causes to this file (servotwin.model/1)")
      .takes("M2.json");
  command
      .option("--suggested-test", arguments->test,
              "if causes cannot be distinguished, write a motion that distinguishes them: "
              "BASE.csv for servotwin simulate, BASE.nc as G-code")
      .takes("BASE");
  command.flag("--details", arguments->details, "print what the search tried, added and removed");
  command.option("--leave-out", arguments->options.leave_out, "causes to leave out of the search")
      .comma_separated()
      .one_of(known_causes())
      .takes("ID,..");
  command.flag("--encoder-in-loop", arguments->options.encoder_in_loop,
               "the recorded encoder is the one that the position loop uses: lead_error, "
               "thermal_growth and a gap behind it are not observable");
  command
      .option_read_by(
          "--training-share",
          [arguments](const std::string& share) {
            arguments->options.identify.training_share = number_of(share).value();
            arguments->options.balance = false;
          },
          "share of the data that is fitted (default 0.6 of the time, or of acceleration or error "
          "where these are uneven over the recording); the rest measures the gain")
      .takes("SHARE")
      .between(0.1, 0.95);
  command
      .option(
          "--delay-max", arguments->options.identify.delay_max_s,
          "longest delay of the encoder record that is searched for [s] (default 0.02); 0: none")
      .takes("S")
      .between(0.0, 0.05);
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
