// servotwin learn: a path corrected in virtual trials on the twin.
#include <cmath>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "cli/common/command.h"
#include "cli/common/model_text.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "cli/recording/correction.h"
#include "cli/recording/path_gcode.h"
#include "diagnosis/report/diagnosis_file.h"
#include "drivers/common/text.h"
#include "identification/model/motion_reach.h"
#include "identification/model/stated_deviations.h"
#include "ilc/path_ends.h"
#include "twin/shown_units.h"

namespace servotwin::cli {
namespace {

const std::map<std::string, Law> kMethods{{"inverse", Law::kInverse},
                                          {"norm-optimal", Law::kNormOptimal},
                                          {"p", Law::kP},
                                          {"pd", Law::kPd},
                                          {"feedforward", Law::kInverse}};

struct LearnArguments {
  TableOptions commands;
  std::filesystem::path table, result, gcode, report;
  std::string method = "inverse";
  std::string aim;                 // empty: tracking
  int trials = 0;                  // 0: ten
  double bandwidth_hz = 0.0;       // 0: the largest that contracts
  double uncertainty = 0.0;        // percent; 0: the model's own
  double peak = 0.0, rate = 0.0;   // um, mm/s; 0: none
  std::optional<double> chord_um;  // absent: 1
};

/// Refuses options that the feed-forward does not use.
void require_meant(const LearnArguments& arguments) {
  if (arguments.method != "feedforward") return;
  const auto refuse = [](bool given, const char* option, const char* why) {
    if (given)
      throw UsageError(std::string("--method feedforward ") + why + ": leave " + option + " out");
  };
  refuse(!arguments.aim.empty(), "--aim", "corrects every axis by itself");
  refuse(arguments.bandwidth_hz > 0.0, "--bandwidth",
         "learns nothing; its bandwidth is the largest that makes no model within the uncertainty "
         "worse");
  refuse(arguments.trials > 0, "--trials", "makes no trial");
}

/// Throws if no axis moves.
void require_motion(const std::string& source, const std::vector<CommandedAxis>& axes) {
  if (std::none_of(axes.begin(), axes.end(),
                   [](const CommandedAxis& axis) { return path_moves(axis.path); }))
    throw std::runtime_error(source + ": no axis with a model moves: there is nothing to correct");
}

/// Warns of a delay between command and encoder: a recording does not tell whether the machine has
/// it, or the recorder alone.
void say_delay(const CommandedAxis& axis, std::FILE* people) {
  const double delay_s = axis.record.model.command_delay_s();
  if (!(delay_s > 0.0)) return;
  const Eigen::ArrayXd& path = axis.path.command;
  const Eigen::Index n = path.size() - 1;
  const double fastest = (path.tail(n) - path.head(n)).abs().maxCoeff() / axis.path.sample_time_s;
  say(people,
      "warning: " + axis.record.axis +
          text(": the model has a delay of %.3g ms between command and encoder. If only the "
               "recording has it, and not the machine, the corrected path leads by up to ",
               1e3 * delay_s) +
          micro_text(delay_s * fastest, axis.record.rotary, 3) + ": see " +
          page_to_read("time_delay") + " before the correction is used");
}

/// Throws if no drive can follow the motion or it is far beyond that of the model; prints whether
/// it is beyond it, or whether that is unknown.
MotionReach look_at_motion(const std::string& source, const CommandedAxis& axis,
                           std::FILE* people) {
  const ModelRecord& record = axis.record;
  if (const std::string jump = jump_in(axis.path, record.axis, record.rotary); !jump.empty())
    throw std::runtime_error(source + ": " + jump);
  MotionReach reach = motion_reach(record, {&axis.path, 1});
  if (reach.far_beyond())
    throw std::runtime_error(source + ": " + reach.words + "; " + kFarBeyondAdvice);
  if (reach.beyond()) {
    say(people, "warning: " + reach.words +
                    "; its prediction for this path is not reliable: identify the model from "
                    "motion that is as fast");
  } else if (!std::isfinite(record.motion.speed)) {
    say(people, "note: the model of " + record.axis +
                    " does not say which speeds it was identified on (identify it again): whether "
                    "this path is within them is not known");
  }
  return reach;
}

CorrectedAxis corrected_axis(const LearnArguments& arguments, CommandedAxis commanded) {
  CorrectionWish wish;
  wish.law = kMethods.at(arguments.method);
  wish.feedforward_only = arguments.method == "feedforward";
  wish.bandwidth_hz = arguments.bandwidth_hz;
  wish.uncertainty_share = arguments.uncertainty / 100.0;
  if (arguments.peak > 0.0) wish.limits.peak = kMicro * arguments.peak;
  if (arguments.rate > 0.0) wish.limits.rate = kMilli * arguments.rate;
  const ModelRecord& record = commanded.record;
  CorrectedAxis out{prepared_axis(record.axis, record.rotary, commanded.model,
                                  stated_deviations(record), commanded.path, wish),
                    {}};
  out.commanded = std::move(commanded);
  return out;
}

std::string figures(const ErrorSize& size, bool rotary) {
  return figures_text({size.rms, size.max}, rotary);
}

std::string times_smaller(double before, double after) {
  if (!(after > 0.0) || after == before) return "";
  if (after > before) return text("  %.3g times larger", after / before);
  return text(before < 100.0 * after ? "  %.3g times smaller" : "  %.0f times smaller",
              before / after);
}

void print(const Correction& correction, std::FILE* people) {
  const Learned& learned = correction.learned;
  const Trial &first = learned.trials.front(), &best = learned.trials[learned.best];
  for (const CorrectedAxis& axis : correction.axes) {
    say(people, axis.learning.name + ": " + bandwidth_text(correction, axis));
  }
  say(people, "tracking error, on the twin:");
  for (std::size_t i = 0; i < correction.axes.size(); ++i) {
    const bool rotary = correction.axes[i].learning.rotary;
    const std::string name = correction.axes[i].learning.name;
    say(people, text("  %-9s before ", name.c_str()) + figures(first.axis[i], rotary));
    say(people, "            after  " + figures(best.axis[i], rotary) +
                    times_smaller(first.axis[i].rms, best.axis[i].rms));
  }
  if (learned.before) {
    say(people, "contour error, the distance from the path:");
    say(people, "            before " + figures(first.contour, false));
    say(people, "            after  " + figures(best.contour, false) +
                    times_smaller(first.contour.rms, best.contour.rms));
    if (const std::string shares = shares_text(correction); !shares.empty())
      say(people, "            made of: " + shares);
    if (learned.before->turned.size() > 0) {
      say(people, "orientation before " + figures(first.turned, true));
      say(people, "            after  " + figures(best.turned, true));
    }
  }
  std::string head = "trial      ", units = "           ";
  for (const CorrectedAxis& axis : correction.axes) {
    head += text("%10s", (axis.learning.name + " RMS").c_str());
    units += text("%10s", text("[%s]", micro(axis.learning.rotary)).c_str());
  }
  say(people, head + (learned.before ? "   contour" : ""));
  say(people, units + (learned.before ? "      [um]" : ""));
  for (std::size_t t = 0; t < learned.trials.size(); ++t) {
    std::string line = text("%5zu%s     ", t, t == learned.best ? "*" : " ");
    for (const ErrorSize& size : learned.trials[t].axis) line += text("%10.4g", 1e6 * size.rms);
    if (learned.before) line += text("%10.4g", 1e6 * learned.trials[t].contour.rms);
    say(people, line);
  }
  if (learned.best == 0) {
    std::vector<LearnAxis> axes;
    for (const CorrectedAxis& axis : correction.axes) axes.push_back(axis.learning);
    const bool other_aim = learned.before && correction.options.aim == Aim::kTracking &&
                           !correction.options.feedforward_only;
    say(people, "note: " + why_none_is_kept(learned, axes) + "; the path is unchanged" +
                    (other_aim ? "; --aim contour corrects the distance from the path only" : ""));
  }
  say(people, learned.ending == Ending::kGrew
                  ? "            * kept; ended, since the errors grew again"
                  : "            * kept");
  if (learned.by_rigid_law)
    say(people,
        "note: learned with the law of the rigid loop, which left less on the twin than that of "
        "the two masses: friction holds the load at times");
  for (std::size_t i = 0; i < correction.axes.size(); ++i) {
    const CorrectedAxis& axis = correction.axes[i];
    const Eigen::ArrayXd& u = learned.axes[i].correction;
    const double steepest = (u.tail(u.size() - 1) - u.head(u.size() - 1)).abs().maxCoeff() /
                            axis.learning.path.sample_time_s;
    const CorrectionLimits& limits = axis.learning.limits;
    const bool rotary = axis.learning.rotary;
    say(people, axis.learning.name +
                    text(": correction up to %.4g %s", 1e6 * u.abs().maxCoeff(), micro(rotary)) +
                    (std::isfinite(limits.peak) ? text(" of %.4g", 1e6 * limits.peak) : "") +
                    text(" and %.4g %s/s", 1e3 * steepest, milli(rotary)) +
                    (std::isfinite(limits.rate) ? text(" of %.4g", 1e3 * limits.rate) : ""));
    if (learned.best == 0) continue;
    const double expected = expected_rms(correction, i);
    say(people, axis.learning.name + ": limited by " + limited_by(correction, i) +
                    (std::isfinite(expected) && correction.options.aim == Aim::kTracking
                         ? text("; expect at least %.3g %s RMS on the machine", 1e6 * expected,
                                micro(rotary))
                         : ""));
  }
  if (const double across = expected_contour_rms(correction); std::isfinite(across))
    say(people, text("contour: expect at least %.3g um RMS on the machine", 1e6 * across));
}

void write_gcode(const LearnArguments& arguments, const Correction& correction,
                 const std::vector<Eigen::ArrayXd>& corrected, std::FILE* people) {
  std::vector<PathAxisText> names;
  std::vector<Eigen::ArrayXd> original;
  for (const CorrectedAxis& axis : correction.axes) {
    names.push_back({axis.learning.name, axis.learning.rotary});
    original.push_back(axis.learning.path.command);
  }
  const double chord_um = arguments.chord_um.value_or(1.0);
  const PathGcode gcode =
      path_gcode(names, original, corrected, correction.axes.front().learning.path.sample_time_s,
                 kMicro * chord_um);
  write_result(arguments.gcode, gcode.text);
  say(people, "G-code: " + counted(static_cast<std::size_t>(gcode.moves), "move") +
                  text(" within %.4g um of the corrected path", chord_um));
}

void run(const LearnArguments& arguments) {
  require_meant(arguments);
  std::FILE* people =
      people_beside({arguments.table, arguments.result, arguments.gcode, arguments.report});
  Correction correction;
  correction.source = arguments.commands.path.file.filename().string();
  correction.method = arguments.method;
  correction.options.aim = arguments.aim == "contour" ? Aim::kContour : Aim::kTracking;
  correction.options.rigid_law_too = true;
  if (arguments.trials > 0) correction.options.trials = arguments.trials;
  correction.options.feedforward_only = arguments.method == "feedforward";
  if (arguments.chord_um && arguments.gcode.empty())
    throw UsageError("--chord-tolerance needs --gcode: it applies to the G1 moves");
  std::vector<CommandedAxis> commanded = read_commands(arguments.commands, "corrected", people);
  require_motion(arguments.commands.path.file.string(), commanded);
  for (CommandedAxis& axis : commanded) {
    if (correction.options.aim == Aim::kContour && axis.record.rotary) {
      say(people, "note: " + axis.record.axis +
                      " is a rotary axis and does not contribute to the distance from the path: it "
                      "learns from its own tracking error");
    }
    if (!arguments.gcode.empty() && axis.record.axis.size() != 1)
      throw UsageError("--gcode needs axes named by one letter, not " + axis.record.axis);
    const MotionReach reach = look_at_motion(arguments.commands.path.file.string(), axis, people);
    say_delay(axis, people);
    correction.axes.push_back(corrected_axis(arguments, std::move(axis)));
    correction.axes.back().beyond_model = reach.beyond();
  }
  std::vector<LearnAxis> axes;
  std::vector<std::string> neighbours;
  for (const CorrectedAxis& axis : correction.axes) {
    axes.push_back(axis.learning);
    neighbours.push_back(axis.commanded.record.neighbour);
  }
  for (const std::size_t i : find_neighbours(axes, neighbours))
    say(people, "note: " + without_neighbour(axes[i].name, neighbours[i]));
  for (const std::string& line : short_rests(axes)) say(people, "warning: " + line);
  {
    const Progress progress("learning");
    correction.learned = learn(axes, on_twins(axes), correction.options);
    if (correction.learned.before) {
      std::vector<Model> models;
      std::vector<Segment> paths;
      std::vector<std::size_t> linear;
      for (std::size_t i = 0; i < axes.size(); ++i) {
        if (axes[i].rotary) continue;
        models.push_back(axes[i].model);
        paths.push_back(axes[i].path);
        linear.push_back(i);
      }
      correction.shares = contour_shares(models, paths, *correction.learned.before);
      for (ContourShare& share : correction.shares) share.axis = linear[share.axis];
    }
  }
  print(correction, people);

  std::vector<Column> columns{{"time[s]", times_of(axes.front().path)}};
  std::vector<Eigen::ArrayXd> corrected;
  for (std::size_t i = 0; i < axes.size(); ++i) {
    corrected.push_back(axes[i].path.command + correction.learned.axes[i].correction);
    columns.push_back({axes[i].name + ".command" + (axes[i].rotary ? "[rad]" : "[m]"),
                       {corrected.back().begin(), corrected.back().end()}});
  }
  if (!arguments.table.empty()) write_result(arguments.table, csv(columns));
  if (!arguments.gcode.empty()) write_gcode(arguments, correction, corrected, people);
  if (!arguments.report.empty()) write_result(arguments.report, report_html(correction));
  if (!arguments.result.empty()) write_json(arguments.result, to_json(correction));
  say_written(people, {arguments.table, arguments.gcode, arguments.report, arguments.result});
}

}  // namespace

Command add_learn(CLI::App& app) {
  const auto arguments = std::make_shared<LearnArguments>();
  OptionTable command(app, "learn", "Corrects a path in advance, in virtual trials on the twin.");
  arguments->commands.declare(command);
  command.option("--out", arguments->table, "write the corrected commands to this file")
      .takes("CORRECTED.csv");
  command
      .option("--json", arguments->result,
              "write the correction with all figures to this file (servotwin.correction/1)")
      .takes("OUT");
  command.option("--gcode", arguments->gcode, "write the corrected path as G1 moves to this file")
      .takes("OUT.nc");
  command
      .option("--chord-tolerance", arguments->chord_um,
              "largest distance of the G1 moves from the corrected path [um] (default 1)")
      .takes("UM")
      .between(1e-3, 1e4);
  command.option("--report", arguments->report, "write a report for people to this file")
      .takes("OUT.html");
  command
      .option("--method", arguments->method,
              "learning law of the trials: inverse (default), norm-optimal, p, pd; or "
              "feedforward: the inverse of the model, without trials")
      .takes("NAME")
      .one_of({"inverse", "norm-optimal", "p", "pd", "feedforward"});
  command
      .option("--aim", arguments->aim,
              "tracking (default): every axis follows its command; contour: the axes follow "
              "the path, and a lag along it is accepted")
      .takes("NAME")
      .one_of({"tracking", "contour"});
  command.option("--trials", arguments->trials, "largest number of virtual trials (default 10)")
      .takes("N")
      .between(1, 1000);
  command.option("--limits-peak", arguments->peak, "the largest correction of an axis [um | urad]")
      .takes("UM")
      .between(1e-3, 1e6);
  command
      .option("--limits-rate", arguments->rate,
              "the fastest change of a correction [mm/s | mrad/s]")
      .takes("MM/S")
      .between(1e-6, 1e6);
  command
      .option("--bandwidth", arguments->bandwidth_hz,
              "bandwidth of the correction [Hz] (default: of learning, the largest at which "
              "every model within the uncertainty contracts; of the feed-forward beneath it, "
              "the largest that makes none of them worse)")
      .takes("HZ")
      .between(kMinBandwidth_hz, 1e5);
  command
      .option("--uncertainty", arguments->uncertainty,
              "uncertainty of every pole and coefficient [%] (default: the model's own deviations)")
      .takes("PERCENT")
      .between(1e-3, 90.0);
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
