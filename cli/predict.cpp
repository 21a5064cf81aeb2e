// servotwin predict: compares a model with a recording, in free simulation.
#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/command.h"
#include "cli/model_text.h"
#include "cli/option_table.h"
#include "cli/options.h"
#include "cli/output.h"
#include "daemon/correct/motion_reach.h"
#include "identification/loop/identify.h"
#include "identification/model/json_number.h"
#include "identification/recording/noise_floor.h"
#include "twin/shown_units.h"
#include "twin/twin.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

inline constexpr const char* kPredictionSchema = "servotwin.prediction/1";

struct PredictArguments {
  AxisOptions input;
  std::filesystem::path model, table, result;
};

struct Judged {
  const Segment* segment = nullptr;
  ErrorFigures figures;   // NaN for a segment that is too short for an initial state
  Eigen::Index rows = 0;  // number of rows that the figures are computed from
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

json result_of(const std::string& axis, const ErrorFigures& all, double noise_floor_rms,
               bool overlaps_training, const std::vector<Judged>& judged) {
  json segments = json::array();
  for (const Judged& one : judged) {
    segments.push_back({{"from_s", one.segment->start_s},
                        {"to_s", one.segment->end_s()},
                        {"rms_m", number_or_null(one.figures.rms)},
                        {"max_m", number_or_null(one.figures.max)},
                        {"rows", one.segment->size()},
                        {"rows_judged", one.rows}});
  }
  return {{"schema", kPredictionSchema},
          {"axis", axis},
          {"rms_m", number_or_null(all.rms)},
          {"max_m", number_or_null(all.max)},
          {"noise_floor_rms_m", number_or_null(noise_floor_rms)},
          {"overlaps_training", overlaps_training},
          {"segments", segments}};
}

/// Whether the recording overlaps the training data of the model, judged by its file name and
/// times.
bool overlaps_training(const ModelRecord& record, const std::string& file,
                       const SegmentedAxis& axis) {
  return record.source == file && record.axis == axis.axis &&
         std::any_of(axis.segments.begin(), axis.segments.end(), [&](const Segment& segment) {
           return segment.start_s < record.training_to_s && segment.end_s() > record.from_s;
         });
}

std::string table_of(const SegmentedAxis& axis, const Model& model) {
  const std::string unit = axis.rotary ? "[rad]" : "[m]";
  std::vector<Column> columns{{"time[s]", {}}};
  for (const char* channel :
       {"command", "actual", "measured_error", "predicted_error", "residual"}) {
    columns.push_back({axis.axis + "." + channel + unit, {}});
  }
  for (const Segment& segment : axis.segments) {
    const Eigen::ArrayXd predicted = simulate(model, segment);
    for (Eigen::Index i = 0; i < segment.size(); ++i) {
      const double measured = segment.command(i) - segment.actual(i);
      const std::array row{segment.start_s + segment.sample_time_s * static_cast<double>(i),
                           segment.command(i),
                           segment.actual(i),
                           measured,
                           predicted(i),
                           measured - predicted(i)};
      for (std::size_t c = 0; c < row.size(); ++c) columns[c].values.push_back(row[c]);
    }
  }
  return csv(columns);
}

void run(const PredictArguments& arguments) {
  std::FILE* people = people_beside({arguments.table, arguments.result});
  const SegmentedAxis axis = arguments.input.read(people);
  const ModelRecord record = read_model_for(arguments.model, axis.axis, axis.rotary);
  if (axis.segments.front().actual.size() == 0) {
    throw std::runtime_error(
        axis.source + ": " + axis.axis +
        ".actual has no values to compare with; servotwin simulate needs none");
  }
  if (record.axis != axis.axis) {
    say(people, "note: the model was identified on axis " + record.axis +
                    ", the recording is of axis " + axis.axis);
  }
  const bool overlaps =
      overlaps_training(record, arguments.input.recording.file.filename().string(), axis);
  if (overlaps) {
    say(people, text("note: the model was fitted to %.2f to %.2f s of this recording, so this "
                     "comparison is no validation; its held-out data are %.2f to %.2f s",
                     record.from_s, record.training_to_s, record.training_to_s, record.to_s));
  }
  const Model model = model_at(record, axis.sample_time_s, people);

  if (const daemon::MotionReach reach = daemon::motion_reach(record, axis.segments); reach.beyond())
    say(people, "note: " + reach.words);

  const Progress progress("predicting " + axis.axis);
  const ErrorFigures all = judge(model, axis.segments);
  if (!std::isfinite(all.rms)) {
    throw std::runtime_error(axis.source + ": " + axis.axis +
                             text(": no segment is longer than the %.3f s that the initial state "
                                  "is estimated from; use a longer part",
                                  starting_state_s(model)));
  }
  std::vector<Judged> judged;
  for (const Segment& segment : axis.segments) {
    const ErrorFigures figures = judge(model, {segment});
    judged.push_back(
        {&segment, figures,
         std::isfinite(figures.rms) ? segment.size() - starting_state_samples(model, segment) : 0});
  }
  const double floor = noise_floor(axis.segments).rms;

  say(people, "model       " + structure_text(model) +
                  (record.version > 0 ? text(", version %d", record.version) : "") +
                  (record.source.empty() ? "" : ", from " + record.source));
  say(people,
      "measured minus predicted tracking error, in free simulation from the command alone:");
  for (const Judged& one : judged) {
    say(people,
        text("%8.2f to %8.2f s  ", one.segment->start_s, one.segment->end_s()) +
            (std::isfinite(one.figures.rms) ? figures_text(one.figures, axis.rotary)
                                            : "too short for an initial state, not evaluated"));
  }
  say(people, "all                    " + figures_text(all, axis.rotary));
  say(people, "noise floor            " + noise_floor_text(floor, axis.rotary));
  if (const double error = tracking_error_rms(model, axis.segments); all.rms > error) {
    say(people, text("note: the tracking error itself is %s RMS only: this model predicts worse "
                     "than none. Are the columns of command and encoder exchanged, is it another "
                     "axis, or was the drive tuned since?",
                     micro_text(error, axis.rotary).c_str()));
  }
  if (!arguments.table.empty()) write_result(arguments.table, table_of(axis, model));
  if (!arguments.result.empty())
    write_json(arguments.result, result_of(axis.axis, all, floor, overlaps, judged));
}

}  // namespace

Command add_predict(CLI::App& app) {
  const auto arguments = std::make_shared<PredictArguments>();
  OptionTable command(
      app, "predict",
      "Predicts the tracking error of a recording and compares it with the measured one.");
  arguments->input.declare(command);
  command.option("--model", arguments->model, "model file (servotwin.model/1)")
      .takes("M.json")
      .required();
  command
      .option(
          "--out", arguments->table,
          "write command, actual position and errors row by row to this file; - is standard output")
      .takes("PRED.csv");
  command
      .option("--json", arguments->result,
              "write the figures to this file (servotwin.prediction/1); - is standard output")
      .takes("OUT");
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
