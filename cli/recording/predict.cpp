// servotwin predict: compares a model with a recording, in free simulation.
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/common/command.h"
#include "cli/common/model_text.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "cli/recording/prediction_plot.h"
#include "identification/loop/identify.h"
#include "identification/loop/torque_output.h"
#include "identification/model/json_number.h"
#include "identification/model/motion_reach.h"
#include "identification/recording/motion_range.h"
#include "identification/recording/noise_floor.h"
#include "twin/neighbour.h"
#include "twin/program_error.h"
#include "twin/shown_units.h"
#include "twin/twin.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

inline constexpr const char* kPredictionSchema = "servotwin.prediction/1";

struct PredictArguments {
  RecordingOptions recording;
  std::vector<std::string> axes;
  std::vector<std::filesystem::path> models;  // in the order of the axes
  std::filesystem::path table, result, plot;
};

struct Judged {
  double from_s = 0.0, to_s = 0.0;
  ErrorFigures figures;             // NaN for a segment that is too short for an initial state
  Eigen::Index size = 0, rows = 0;  // number of rows, and of those that the figures come from
};

/// One axis of the recording with the model that predicts it.
struct PredictedAxis {
  SegmentedAxis axis;
  ModelRecord record;
  Model model;  // for the sampling time of the recording
  bool overlaps_training = false;
  std::string driven_by = "the command alone";
  ErrorFigures all;
  std::vector<Judged> judged;
  RmsEstimate noise_floor;
  TorqueError torque_error;  // NaN where the recording has none in the unit of the model's
};

/// Over the same rows [m].
struct ContourFigures {
  ErrorFigures predicted, measured, residual;  // residual: measured minus predicted
  Eigen::Index rows = 0;
};

/// RMS of the measured tracking error over the rows that the prediction is judged on.
double tracking_error_rms(const Model& model, const std::vector<Segment>& segments) {
  double squares = 0.0, count = 0.0;
  for (const Segment& segment : segments) {
    const Eigen::Index rows = segment.size() - starting_state_samples(model, segment);
    if (rows <= 0) continue;
    squares += (segment.command - segment.actual).tail(rows).square().sum();
    count += static_cast<double>(rows);
  }
  return std::sqrt(squares / count);
}

/// Of all segments, and where it was recorded in the unit of the model's the recorded one.
struct Torques {
  Eigen::ArrayXd predicted, measured;  // the latter without absent values, or empty
};
Torques torques_of(const PredictedAxis& one) {
  std::vector<double> predicted, measured;
  for (const Segment& s : one.axis.segments) {
    const Eigen::ArrayXd of_motor =
        simulated_torque(one.model, one.record.torque->by, one.record.torque->lag, s);
    predicted.insert(predicted.end(), of_motor.begin(), of_motor.end());
    if (one.axis.torque_unit == one.record.torque->unit)
      std::copy_if(s.torque.begin(), s.torque.end(), std::back_inserter(measured),
                   [](double value) { return std::isfinite(value); });
  }
  const auto array = [](const std::vector<double>& of) -> Eigen::ArrayXd {
    return Eigen::Map<const Eigen::ArrayXd>(of.data(), std::ssize(of));
  };
  return {array(predicted), array(measured)};
}

/// null where the model has no torque.
json torque_json(const PredictedAxis& one) {
  if (!one.record.torque) return nullptr;
  const auto [predicted, measured] = torques_of(one);
  json out = {{"unit", one.record.torque->unit},
              {"lowest_predicted", predicted.minCoeff()},
              {"highest_predicted", predicted.maxCoeff()},
              {"rms_predicted", std::sqrt(predicted.square().mean())},
              {"rms", number_or_null(one.torque_error.rms)},
              {"scatter", number_or_null(one.torque_error.scatter)}};
  if (measured.size() > 0) {
    out["lowest_measured"] = measured.minCoeff();
    out["highest_measured"] = measured.maxCoeff();
  }
  return out;
}

/// What is wrong with a recorded torque of which most is left; empty: nothing that is known.
std::string why_other_torque(const PredictedAxis& one) {
  constexpr double kMaxShare = 0.7, kOtherUnit = 5.0;
  if (!(one.torque_error.share() > kMaxShare)) return {};
  double product = 0.0, square = 0.0;
  for (const Segment& s : one.axis.segments) {
    if (s.torque.size() != s.size()) continue;
    const Eigen::ArrayXd predicted =
        simulated_torque(one.model, one.record.torque->by, one.record.torque->lag, s);
    for (Eigen::Index k = 0; k < s.size(); ++k) {
      if (!std::isfinite(s.torque(k))) continue;
      product += s.torque(k) * predicted(k);
      square += predicted(k) * predicted(k);
    }
  }
  const double slope = product / square;
  if (slope < 0.0) return "the recorded torque has the opposite sign to the model's";
  if (slope > kOtherUnit || slope < 1.0 / kOtherUnit)
    return text("the recorded torque is %.3g times the model's: is its unit right?", slope);
  return "the recorded torque is not that of this motion, or some of its values are wrong";
}

json result_of(const PredictedAxis& one) {
  json segments = json::array();
  for (const Judged& judged : one.judged) {
    segments.push_back({{"from_s", judged.from_s},
                        {"to_s", judged.to_s},
                        {"rms_m", number_or_null(judged.figures.rms)},
                        {"max_m", number_or_null(judged.figures.max)},
                        {"rows", judged.size},
                        {"rows_judged", judged.rows}});
  }
  return {{"axis", one.axis.axis},
          {"rms_m", number_or_null(one.all.rms)},
          {"max_m", number_or_null(one.all.max)},
          {"noise_floor_rms_m", number_or_null(one.noise_floor.rms)},
          {"noise_floor_interval_m", interval_or_null(one.noise_floor)},
          {"overlaps_training", one.overlaps_training},
          {"predicted_from", one.driven_by},
          {"torque", torque_json(one)},
          {"segments", segments}};
}

json result_of(const std::vector<PredictedAxis>& all,
               const std::optional<ContourFigures>& contour) {
  json out = all.size() == 1 ? result_of(all.front()) : json::object();
  out["schema"] = kPredictionSchema;
  if (all.size() == 1) return out;
  out["axes"] = json::array();
  for (const PredictedAxis& one : all) out["axes"].push_back(result_of(one));
  const auto figures = [](const ErrorFigures& errors) {
    return json{{"rms_m", number_or_null(errors.rms)}, {"max_m", number_or_null(errors.max)}};
  };
  out["contour"] = contour ? json{{"predicted", figures(contour->predicted)},
                                  {"measured", figures(contour->measured)},
                                  {"residual", figures(contour->residual)},
                                  {"rows", contour->rows}}
                           : json();
  return out;
}

/// Whether the recording overlaps the training data of the model, judged by its file name and
/// times.
bool overlaps_training(const ModelRecord& record, const std::string& file,
                       const SegmentedAxis& axis) {
  // Two recordings of standard input are not one.
  return file != "-" && record.source == file && record.axis == axis.axis &&
         std::any_of(axis.segments.begin(), axis.segments.end(), [&](const Segment& segment) {
           return segment.start_s < record.training_to_s && segment.end_s() > record.from_s;
         });
}

/// Whether all axes have the same segments, so that their rows belong together.
bool same_segments(const std::vector<PredictedAxis>& all) {
  const std::vector<Segment>& first = all.front().axis.segments;
  return std::all_of(all.begin(), all.end(), [&](const PredictedAxis& one) {
    return std::equal(first.begin(), first.end(), one.axis.segments.begin(),
                      one.axis.segments.end(), [](const Segment& l, const Segment& r) {
                        return l.start_s == r.start_s && l.size() == r.size();
                      });
  });
}

std::string table_of(const std::vector<PredictedAxis>& all) {
  if (!same_segments(all))
    throw std::runtime_error(
        "--out: the axes have gaps at different times, so that a row does not belong to all of "
        "them; write one table per axis");
  std::vector<Column> columns{{"time[s]", {}}};
  for (const PredictedAxis& one : all) {
    const SegmentedAxis& axis = one.axis;
    const std::string unit = axis.rotary ? "[rad]" : "[m]";
    const std::size_t first = columns.size();
    for (const char* channel :
         {"command", "actual", "measured_error", "predicted_error", "residual"}) {
      columns.push_back({axis.axis + "." + channel + unit, {}});
    }
    std::vector<double> torque, predicted_torque;
    for (std::size_t k = 0; k < axis.segments.size(); ++k) {
      const Segment& segment = axis.segments[k];
      const Eigen::ArrayXd predicted = simulate(one.model, segment);
      if (one.record.torque) {
        const Eigen::ArrayXd of_motor =
            simulated_torque(one.model, one.record.torque->by, one.record.torque->lag, segment);
        predicted_torque.insert(predicted_torque.end(), of_motor.begin(), of_motor.end());
      }
      torque.insert(torque.end(), segment.torque.begin(), segment.torque.end());
      for (Eigen::Index i = 0; i < segment.size(); ++i) {
        if (first == 1)
          columns[0].values.push_back(segment.start_s +
                                      segment.sample_time_s * static_cast<double>(i));
        const double measured = segment.command(i) - segment.actual(i);
        const std::array row{segment.command(i), segment.actual(i), measured, predicted(i),
                             measured - predicted(i)};
        for (std::size_t c = 0; c < row.size(); ++c) columns[first + c].values.push_back(row[c]);
      }
    }
    if (one.record.torque && torque.size() == predicted_torque.size())
      columns.push_back({axis.axis + ".torque[" + axis.torque_unit + "]", std::move(torque)});
    if (!predicted_torque.empty())
      columns.push_back({axis.axis + ".predicted_torque[" + one.record.torque->unit + "]",
                         std::move(predicted_torque)});
  }
  return csv(columns);
}

std::string plot_of(const std::vector<PredictedAxis>& all) {
  std::vector<PlotPanel> panels;
  for (const PredictedAxis& one : all) {
    for (PlotPanel& panel : prediction_panels(one.axis.axis, one.axis.rotary, one.model,
                                              one.axis.segments, one.all, one.noise_floor))
      panels.push_back(std::move(panel));
  }
  return plot_rows_svg(panels);
}

/// Of the linear axes, if they form a path and their rows belong together.
std::optional<ContourFigures> contour_of(const std::vector<PredictedAxis>& all) {
  std::vector<const PredictedAxis*> path;
  for (const PredictedAxis& one : all) {
    if (!one.axis.rotary) path.push_back(&one);
  }
  if (path.size() < 2 || path.size() > kMaxPathAxes || !same_segments(all)) return std::nullopt;
  Eigen::ArrayXd predicted(0), measured(0);
  const auto append = [](Eigen::ArrayXd& to, const Eigen::ArrayXd& more) {
    to.conservativeResize(to.size() + more.size());
    to.tail(more.size()) = more;
  };
  for (std::size_t k = 0; k < path.front()->axis.segments.size(); ++k) {
    std::vector<Eigen::ArrayXd> command, actual, simulated;
    Eigen::Index used = 0;
    for (const PredictedAxis* one : path) {
      const Segment& segment = one->axis.segments[k];
      command.push_back(segment.command);
      actual.push_back(segment.actual);
      simulated.emplace_back(segment.command - simulate(one->model, segment));
      used = std::max({used, segment.lead, starting_state_samples(one->model, segment)});
    }
    const Eigen::Index rows = command.front().size() - used;
    if (rows <= 0) continue;
    append(predicted, program_error(command, simulated).distance.tail(rows));
    append(measured, program_error(command, actual).distance.tail(rows));
  }
  if (measured.size() == 0) return std::nullopt;
  const auto figures_of = [](const Eigen::ArrayXd& errors) {
    return ErrorFigures{std::sqrt(errors.square().mean()), errors.abs().maxCoeff()};
  };
  return ContourFigures{figures_of(predicted), figures_of(measured),
                        figures_of(measured - predicted), measured.size()};
}

/// Throws where a model is that of another of the axes: two of them were exchanged.
void require_order(const PredictArguments& arguments) {
  if (arguments.axes.size() < 2) return;
  for (std::size_t i = 0; i < arguments.axes.size(); ++i) {
    const std::string of = read_model(arguments.models[i]).axis;
    if (of != arguments.axes[i] &&
        std::find(arguments.axes.begin(), arguments.axes.end(), of) != arguments.axes.end())
      throw UsageError(arguments.models[i].string() + " is a model of axis " + of +
                       ", and is given for axis " + arguments.axes[i] +
                       ": give the models in the order of the axes");
  }
}

/// Sets the motion of the axis that acts on this one: as its own model predicts it, if that is
/// given too. What the prediction then follows from.
std::string with_acting_axis(const PredictArguments& arguments, const ModelRecord& record,
                             const Model& model, SegmentedAxis& axis, std::FILE* people) {
  for (std::size_t i = 0; i < arguments.axes.size(); ++i) {
    if (arguments.axes[i] != axis.neighbour) continue;
    const ModelRecord other = read_model(arguments.models[i]);
    const Model at_rate = model_at(other, axis.sample_time_s, people);
    for (Segment& segment : axis.segments)
      predict_neighbour(segment, model, at_rate, pushed_by(other, record.axis));
    return "the commands of " + axis.axis + " and " + axis.neighbour;
  }
  if (std::all_of(axis.segments.begin(), axis.segments.end(),
                  [](const Segment& s) { return s.neighbour_motion.size() > 0; }))
    return "the command and the recorded motion of " + axis.neighbour + " (give --axis " +
           axis.neighbour + " and its --model too for commands alone)";
  say(people, "note: the model contains the motion of axis " + axis.neighbour +
                  ", which is not recorded: its command stands in for it; give --axis " +
                  axis.neighbour + " and its --model as well");
  return "the commands of " + axis.axis + " and " + axis.neighbour;
}

PredictedAxis predicted_axis(const PredictArguments& arguments, const Recording& recording,
                             std::size_t at, std::FILE* people) {
  PredictedAxis out;
  const bool rotary = std::any_of(
      recording.axes.begin(), recording.axes.end(),
      [&](const AxisRecord& one) { return one.name == arguments.axes[at] && one.rotary; });
  out.record = read_model_for(arguments.models[at], arguments.axes[at], rotary);
  const ModelRecord& record = out.record;
  const bool coupled = coupling_of(record.model) != nullptr;
  out.axis = segmented(recording, arguments.axes[at], people, coupled ? record.neighbour : "");
  const SegmentedAxis& axis = out.axis;
  if (coupled && axis.neighbour.empty())
    say(people, "note: the model contains the acceleration of " +
                    (record.neighbour.empty() ? "another axis" : "axis " + record.neighbour) +
                    ", which the recording does not: its part of the error is missing");
  if (axis.segments.front().actual.size() == 0) {
    throw std::runtime_error(
        axis.source + ": " + axis.axis +
        ".actual has no values to compare with; servotwin simulate needs none");
  }
  if (const std::string why = why_implausible(axis.segments, axis.rotary); !why.empty())
    throw std::runtime_error(axis.source + ": " + axis.axis + ".command " + why);
  if (record.axis != axis.axis) {
    say(people, "note: the model was identified on axis " + record.axis +
                    ", the recording is of axis " + axis.axis);
  }
  out.overlaps_training =
      overlaps_training(record, arguments.recording.file.filename().string(), axis);
  if (out.overlaps_training) {
    say(people, text("note: the model was fitted to %.2f to %.2f s of this recording, so this "
                     "comparison is no validation; its held-out data are %.2f to %.2f s",
                     record.from_s, record.training_to_s, record.training_to_s, record.to_s));
  }
  out.model = model_at(record, axis.sample_time_s, people);
  if (coupled_by_motion(out.model) && !axis.neighbour.empty())
    out.driven_by = with_acting_axis(arguments, record, out.model, out.axis, people);
  if (const MotionReach reach = motion_reach(record, axis.segments); reach.beyond())
    say(people, "note: " + reach.words);

  const Progress progress("predicting " + axis.axis);
  out.all = judge(out.model, axis.segments);
  if (!std::isfinite(out.all.rms)) {
    throw std::runtime_error(axis.source + ": " + axis.axis +
                             text(": no segment is longer than the %.3f s that the initial state "
                                  "is estimated from; use a longer part",
                                  starting_state_s(out.model)));
  }
  for (const Segment& segment : axis.segments) {
    const ErrorFigures figures = judge(out.model, {segment});
    out.judged.push_back({segment.start_s, segment.end_s(), figures, segment.size(),
                          std::isfinite(figures.rms)
                              ? segment.size() - starting_state_samples(out.model, segment)
                              : 0});
  }
  out.noise_floor = noise_floor(axis.segments);
  if (record.torque && has_torque(axis)) {
    if (axis.torque_unit == record.torque->unit)
      out.torque_error =
          torque_error(out.model, record.torque->by, record.torque->lag, axis.segments);
    else
      say(people, "note: the torque of the model is in " + record.torque->unit +
                      ", that of the recording in " + axis.torque_unit + ": not compared");
  }
  return out;
}

void print(const PredictedAxis& one, std::FILE* people) {
  const bool rotary = one.axis.rotary;
  say(people, "model       " + structure_text(one.model) +
                  (one.record.version > 0 ? text(", version %d", one.record.version) : "") +
                  (one.record.source.empty() ? "" : ", from " + one.record.source));
  say(people,
      "measured minus predicted tracking error, in free simulation from " + one.driven_by + ":");
  for (const Judged& judged : one.judged) {
    say(people,
        text("%8.2f to %8.2f s  ", judged.from_s, judged.to_s) +
            (std::isfinite(judged.figures.rms) ? figures_text(judged.figures, rotary)
                                               : "too short for an initial state, not evaluated"));
  }
  tell(people, "all                    " + figures_text(one.all, rotary));
  const double error = tracking_error_rms(one.model, one.axis.segments);
  say(people, text("tracking error         %9.3f %s RMS", 1e6 * error, micro(rotary)));
  say(people, "noise floor            " + noise_floor_text(one.noise_floor, rotary));
  if (one.record.torque) {
    const std::string& unit = one.record.torque->unit;
    const auto [predicted, measured] = torques_of(one);
    std::string line = torque_range_text(predicted, unit) + " predicted";
    if (measured.size() > 0) line += ", " + torque_range_text(measured, unit) + " measured";
    if (std::isfinite(one.torque_error.share()))
      line += "; " + torque_error_text(one.torque_error.rms, one.torque_error.scatter, unit);
    say(people, "torque                 " + line);
    if (const std::string why = why_other_torque(one); !why.empty()) say(people, "note: " + why);
  }
  if (one.all.rms > error) {
    say(people, text("note: the tracking error itself is %s RMS only: this model predicts worse "
                     "than none. Are the columns of command and encoder exchanged, is it another "
                     "axis, or was the drive tuned since?",
                     micro_text(error, rotary).c_str()));
  }
}

void require_each_once(const std::vector<std::string>& axes) {
  for (const std::string& axis : axes) {
    if (std::count(axes.begin(), axes.end(), axis) > 1)
      throw UsageError("--axis " + axis + " is given twice");
  }
}

void run(PredictArguments arguments) {
  // Without --axis the axis is the only one of the recording.
  const std::size_t count = std::max<std::size_t>(arguments.axes.size(), 1);
  if (arguments.models.size() != count) {
    throw UsageError(
        text("%zu axes and %zu models: give one --model for each --axis, in the same "
             "order",
             count, arguments.models.size()));
  }
  std::FILE* people = people_beside({arguments.table, arguments.result, arguments.plot});
  const Recording recording =
      arguments.recording.read(people, arguments.axes.size() == 1 ? arguments.axes.front() : "");
  arguments.axes.resize(count);
  for (std::string& axis : arguments.axes) axis = axis_of(recording, axis);
  require_each_once(arguments.axes);
  require_order(arguments);
  std::vector<PredictedAxis> all;
  for (std::size_t i = 0; i < count; ++i) {
    if (count > 1) say(people, "\naxis        " + arguments.axes[i]);
    all.push_back(predicted_axis(arguments, recording, i, people));
    print(all.back(), people);
  }
  const std::optional<ContourFigures> contour = contour_of(all);
  if (contour) {
    say(people, "\ncontour error of the linear axes:");
    say(people, "predicted              " + figures_text(contour->predicted, false));
    say(people, "measured               " + figures_text(contour->measured, false));
    tell(people, "measured - predicted   " + figures_text(contour->residual, false));
  } else if (count > 1) {
    say(people, same_segments(all)
                    ? "\nnote: no contour error: a path has two to five linear axes"
                    : "\nnote: no contour error: the axes have gaps at different times");
  }
  if (!arguments.table.empty()) write_result(arguments.table, table_of(all));
  if (!arguments.result.empty()) write_json(arguments.result, result_of(all, contour));
  if (!arguments.plot.empty()) write_result(arguments.plot, plot_of(all));
  say_written(people, {arguments.table, arguments.result, arguments.plot});
}

}  // namespace

Command add_predict(CLI::App& app) {
  const auto arguments = std::make_shared<PredictArguments>();
  OptionTable command(
      app, "predict",
      "Predicts the tracking error of a recording and compares it with the measured one.");
  arguments->recording.declare(command, "REC", kRecordingHelp);
  command
      .option("--axis", arguments->axes,
              "axis of the recording, if it has several; given several times: also the contour "
              "error of these axes")
      .takes("X")
      .one_value_each_time();
  command
      .option("--model", arguments->models,
              "model file (servotwin.model/1); one for each --axis, in the same order")
      .takes("M.json")
      .required()
      .one_value_each_time();
  command
      .option(
          "--out", arguments->table,
          "write command, actual position and errors row by row to this file; - is standard output")
      .takes("PRED.csv");
  command
      .option("--json", arguments->result,
              "write the figures to this file (servotwin.prediction/1); - is standard output")
      .takes("OUT");
  command
      .option("--plot", arguments->plot,
              "write a plot of the tracking error, measured and predicted, to this file (SVG)")
      .takes("OUT.svg");
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
