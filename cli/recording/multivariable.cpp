// servotwin multivariable: the response of all axes together to all commands and frictions, and
// their common modes.
#include "identification/response/multivariable.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/common/axis_channels.h"
#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/options.h"
#include "cli/common/output.h"
#include "diagnosis/report/bode.h"
#include "drivers/common/text.h"
#include "drivers/recordings/matlab/mat_writer.h"
#include "identification/loop/identify.h"
#include "identification/model/json_number.h"
#include "identification/response/frequency_response.h"
#include "twin/hold.h"
#include "twin/shown_units.h"
#include "twin/two_pi.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

// Every segment needs an initial state of its own; in a shorter one that outweighs what it
// contributes.
constexpr Eigen::Index kMinSegment_rows = 200;
// Initial values of the search for break distances [um | urad].
constexpr const char* kBreakDistances = "1,2,5,10,20,50";
// Residual over output on held-out data; above it, the fit is not usable.
constexpr double kMaxResidualShare = 0.5;
constexpr double kMaxPartsOverOutput = 3.0;          // above, correlated inputs cancel each other
constexpr double kMaxRelativeDeviation = 1.0 / 3.0;  // of a determined value, as for a pole
const std::vector<std::string> kInputs{"command", "friction", "torque"};
const std::vector<std::string> kOutputs{"error", "velocity", "torque"};

struct MultivariableArguments {
  RecordingOptions recording;
  std::string inputs, outputs;
  std::string break_distances;  // empty: searched for
  MultivariableOptions options;
  std::filesystem::path matrices, plot, result;
};

struct Signal {
  Channel channel;
  std::string name;           // for people
  std::string unit;           // of what is fitted
  std::string position_unit;  // of its axis
};

struct Signals {
  std::vector<Signal> inputs, outputs;
  MultivariableData data;
};

std::vector<double> break_distances(const std::string& list) {
  std::vector<double> out;
  for (const std::string& part : split_fields(list, ',')) {
    const double value = number_of(part).value_or(0.0);
    if (!(value > 0.0) || !(value <= 1e6))
      throw UsageError("--break-distance: " + in_quotes(part) +
                       " must be a number from above 0 to 1e6 [um | urad]");
    if (std::find(out.begin(), out.end(), value / 1e6) != out.end())
      throw UsageError("--break-distance: " + in_quotes(part) + " is given twice");
    out.push_back(value / 1e6);
  }
  return out;
}

bool moves(const SegmentedAxis& axis) {
  return std::any_of(axis.segments.begin(), axis.segments.end(), [](const Segment& segment) {
    return segment.command.maxCoeff() > segment.command.minCoeff();
  });
}

/// Every axis that moves.
std::string all_of(const Recording& whole, AxisChannels& axes, const std::string& what,
                   std::FILE* people) {
  std::string out;
  for (const AxisRecord& axis : whole.axes) {
    if (!moves(axes.segmented(axis.name))) {
      say(people, "note: " + axis.name + " stands still and is left out");
      continue;
    }
    for (const std::string& name : split_fields(what, ','))
      out += (out.empty() ? "" : ",") + axis.name + "." + name;
  }
  if (out.empty()) throw std::runtime_error(whole.source + ": no axis moves");
  return out;
}

/// Removes the elements of frictions that never slide in the training data.
void leave_out_long_distances(Signals& signals, const MultivariableOptions& options,
                              std::FILE* people) {
  std::map<std::string, std::pair<double, int>> left;  // of every friction: longest, and how many
  const auto erase = [](auto& list, std::size_t i) {
    list.erase(list.begin() + static_cast<std::ptrdiff_t>(i));
  };
  for (std::size_t i = 0; i < signals.inputs.size();) {
    if (signals.inputs[i].channel.name != "friction") {
      ++i;
      continue;
    }
    const Signal input = signals.inputs[i];
    auto& [longest, kept] = left[input.name];
    longest = longest_break_distance(signals.data, i, options);
    if (signals.data.inputs[i].break_distance <= longest) {
      ++kept, ++i;
      continue;
    }
    const double distance = signals.data.inputs[i].break_distance;
    erase(signals.inputs, i);
    erase(signals.data.inputs, i);
    for (MultivariableRecord& record : signals.data.records) erase(record.inputs, i);
    say(people, text("note: %s: the element with break distance %g u%s is left out: it would be "
                     "proportional to the position, because the axis travels only %.4g u%s",
                     input.name.c_str(), distance / kMicro, input.position_unit.c_str(),
                     4.0 * longest / kMicro, input.position_unit.c_str()));
  }
  for (const auto& [name, of] : left) {
    if (of.second == 0)
      throw std::runtime_error(name + text(": the axis travels too little for any of these break "
                                           "distances; give --break-distance below %.3g",
                                           of.first / kMicro));
  }
}

Signals read(const MultivariableArguments& arguments, std::FILE* people) {
  const std::vector<double> distances = break_distances(
      arguments.break_distances.empty() ? kBreakDistances : arguments.break_distances);
  const Recording whole = arguments.recording.read(people);
  if (whole.axes.empty()) throw std::runtime_error(whole.source + ": no axis");
  // Begins with the first axis that is named, so that an error of reading names that axis.
  const auto listed_channels = [&whole](const std::string& list,
                                        const std::vector<std::string>& known) {
    std::vector<Channel> out;
    for (const std::string& one : split_fields(list, ',')) {
      if (one.ends_with(".position"))
        throw UsageError(in_quotes(one) + " grows without bound with the command; use " +
                         one.substr(0, one.size() - 8) +
                         "error as output (position = command - error)");
      out.push_back(channel_of(one, "", known, whole));
    }
    return out;
  };
  std::vector<Channel> inputs, outputs;
  if (!arguments.inputs.empty()) inputs = listed_channels(arguments.inputs, kInputs);
  if (!arguments.outputs.empty()) outputs = listed_channels(arguments.outputs, kOutputs);
  for (const Channel& input : inputs) {
    for (const Channel& output : outputs) {
      if (input.axis == output.axis && input.name == output.name)
        throw UsageError("--input and --output both have " +
                         in_quotes(input.axis + "." + input.name));
    }
  }
  AxisChannels axes(whole,
                    !outputs.empty()  ? outputs.front().axis
                    : !inputs.empty() ? inputs.front().axis
                                      : whole.axes.front().name,
                    people);
  if (inputs.empty())
    inputs = listed_channels(all_of(whole, axes, "command,friction", people), kInputs);
  if (outputs.empty()) outputs = listed_channels(all_of(whole, axes, "error", people), kOutputs);

  for (std::size_t i = 0; i < inputs.size(); ++i) {
    const Channel& input = inputs[i];
    const auto same = [&](const Channel& other) {
      return other.axis == input.axis && other.name == input.name;
    };
    if (std::any_of(inputs.begin(), inputs.begin() + static_cast<std::ptrdiff_t>(i), same))
      throw UsageError("--input has " + in_quotes(input.axis + "." + input.name) + " twice");
    if (input.name == "command" && !moves(axes.segmented(input.axis)))
      throw std::runtime_error(whole.source + ": " + input.axis +
                               ".command never changes: its effect cannot be identified");
  }
  for (const Channel& output : outputs) {
    if (output.name != "error") continue;
    require_encoder(axes.segmented(output.axis));
    if (const std::string why = why_scaled(axes.segmented(output.axis).segments); !why.empty())
      throw std::runtime_error(whole.source + ": " + output.axis + ": " + why);
  }

  Signals out;
  const auto signal = [&](const Channel& channel) {
    const SegmentedAxis& axis = axes.segmented(channel.axis);
    const std::string unit = axis.rotary ? "rad" : "m";
    Signal one{channel, channel.axis + "." + channel.name, unit, unit};
    if (channel.name == "command" || channel.name == "velocity") one.unit += "/s";
    if (channel.name == "torque") one.unit = axis.torque_unit;
    return one;
  };
  int source = 0;
  for (const Channel& channel : inputs) {
    if (channel.name != "friction") {
      out.inputs.push_back(signal(channel));
      out.data.inputs.push_back({channel.name == "command", source++});
      continue;
    }
    for (const double distance : distances) {
      Signal one = signal(channel);
      one.unit = "1";
      out.inputs.push_back(one);
      out.data.inputs.push_back({false, source, distance, one.position_unit == "rad"});
    }
    ++source;
  }
  for (const Channel& channel : outputs) out.outputs.push_back(signal(channel));

  const double h = axes.sample_time_s();
  out.data.sample_time_s = h;
  Eigen::Index dropped = 0;
  for (std::size_t i = 0; i < axes.segments(); ++i) {
    MultivariableRecord record;
    for (const Signal& input : out.inputs) {
      Channel from = input.channel;
      if (from.name == "friction") from.name = "position";
      Eigen::ArrayXd values = axes.values(from, i);
      if (input.channel.name == "command") values = Spline::through(values, h).first;
      record.inputs.push_back(std::move(values));
    }
    for (const Signal& output : out.outputs) {
      Channel from = output.channel;
      if (from.name == "velocity") from.name = "position";
      Eigen::ArrayXd values = axes.values(from, i);
      if (output.channel.name == "velocity") values = Spline::through(values, h).first;
      record.outputs.push_back(std::move(values));
    }
    std::vector<const Eigen::ArrayXd*> all;
    for (const Eigen::ArrayXd& x : record.inputs) all.push_back(&x);
    for (const Eigen::ArrayXd& x : record.outputs) all.push_back(&x);
    for (const auto& [begin, count] : finite_stretches(all)) {
      if (count < kMinSegment_rows) {
        dropped += count;
        continue;
      }
      MultivariableRecord part;
      for (const Eigen::ArrayXd& x : record.inputs) part.inputs.push_back(x.segment(begin, count));
      for (const Eigen::ArrayXd& x : record.outputs)
        part.outputs.push_back(x.segment(begin, count));
      out.data.records.push_back(std::move(part));
    }
  }
  if (dropped > 0)
    say(people,
        text("%td rows in segments of less than %td rows are left out", dropped, kMinSegment_rows));
  if (out.data.records.empty())
    throw std::runtime_error(
        whole.source +
        text(": no segment of %td rows in which all signals have values", kMinSegment_rows));
  leave_out_long_distances(out, arguments.options, people);
  return out;
}

/// A length in micrometres, a velocity in mm/s, else as it is.
std::string amount(double value, const std::string& unit) {
  if (unit == "m" || unit == "rad") return text("%.4g u", value / kMicro) + unit;
  if (unit == "m/s" || unit == "rad/s") return text("%.4g m", value * 1e3) + unit;
  return text("%.4g ", value) + unit;
}

bool first_of_source(const Signals& signals, std::size_t i) {
  return i == 0 || signals.data.inputs[i].source != signals.data.inputs[i - 1].source;
}

std::string inputs_text(const Signals& signals, bool sought) {
  std::string out;
  for (std::size_t i = 0; i < signals.inputs.size(); ++i) {
    const Signal& input = signals.inputs[i];
    const bool first = first_of_source(signals, i);
    const bool last = i + 1 == signals.inputs.size() || first_of_source(signals, i + 1);
    if (first) out += (out.empty() ? "" : ", ") + input.name;
    if (input.channel.name == "command") out += " (its velocity)";
    if (input.channel.name != "friction") continue;
    if (first) out += sought ? " (break distances searched for from " : " of ";
    if (!first) out += ", ";
    out += text("%g", signals.data.inputs[i].break_distance / kMicro);
    if (last) out += " u" + input.position_unit + (sought ? ")" : "");
  }
  return out;
}

/// The break distances found for each friction, and whether they were accepted.
void say_distances(std::FILE* people, const Signals& signals, const MultivariableFit& fit) {
  const BreakDistanceTrial& trial = fit.distances;
  if (!std::isfinite(trial.left_found)) {
    say(people,
        "note        the break distances were not searched for: the data fitted first are too "
        "short for this order");
    return;
  }
  say(people, text("friction    residual share %.3g with the break distances found, %.3g with the "
                   "initial ones: %s",
                   trial.left_found, trial.left_given,
                   trial.taken ? "accepted" : "no gain, the initial ones are kept"));
  if (!trial.taken) return;
  std::string line, open;
  for (std::size_t i = 0; i < signals.inputs.size(); ++i) {
    const Signal& input = signals.inputs[i];
    if (input.channel.name != "friction") continue;
    if (first_of_source(signals, i)) line = open = "";
    const double value = fit.break_distances[i], deviation = fit.break_deviations[i];
    if (deviation < kMaxRelativeDeviation * value)
      line += text("%s%.3g +- %.2g", line.empty() ? "" : ", ", value / kMicro, deviation / kMicro);
    else
      open += text("%s%.3g", open.empty() ? "" : ", ", value / kMicro);
    if (i + 1 < signals.inputs.size() && !first_of_source(signals, i + 1)) continue;
    const std::string unit = " u" + input.position_unit;
    say(people, "  " + input.name + " breaks away after " + (line.empty() ? "" : line + unit) +
                    (open.empty() ? ""
                                  : (line.empty() ? "" : "; ") + open + unit +
                                        " (+- beyond a third: not determined)"));
  }
}

void say_fit(std::FILE* people, const Signals& signals, const MultivariableFit& fit, bool sought) {
  std::string tried;
  for (const MultivariableTrial& trial : fit.trials)
    tried += text("%s%d%s %.3g", tried.empty() ? "" : ", ", trial.order, trial.chosen ? " ->" : "",
                  trial.left);
  if (!tried.empty())
    say(people, "order       residual share of the outputs on held-out data: " + tried);
  if (sought) say_distances(people, signals, fit);
  std::string open;
  for (const FittedPole& pole : fit.poles) {
    if (!pole.determined()) {
      open += text("%s%.4g Hz", open.empty() ? "" : ", ", pole.omega / kTwoPi);
      continue;
    }
    std::string line = text("%s %.5g +- %.2g Hz",
                            !pole.pair        ? "real pole  "
                            : pole.zeta < 1.0 ? "mode       "
                                              : "real pair  ",
                            pole.omega / kTwoPi, pole.omega_deviation / kTwoPi);
    if (pole.pair) line += text(", damping %.4g +- %.2g", pole.zeta, pole.zeta_deviation);
    say(people, line);
  }
  if (!open.empty())
    say(people,
        "note        not determined by these data (+- beyond a third of the value, or on a bound "
        "of the search): poles at " +
            open);
  for (std::size_t j = 0; j < signals.outputs.size(); ++j) {
    const auto row = static_cast<Eigen::Index>(j);
    const std::string& unit = signals.outputs[j].unit;
    say(people, "output      " + signals.outputs[j].name + ": " +
                    amount(fit.holdout_outputs(row), unit) + " RMS, residual " +
                    amount(fit.holdout(row), unit) +
                    text(" (%.3g %%) on held-out data, ",
                         100.0 * fit.holdout(row) / fit.holdout_outputs(row)) +
                    amount(fit.training(row), unit) + " on training data");
    std::string parts;
    for (std::size_t i = 0; i < signals.inputs.size(); ++i) {
      if (!first_of_source(signals, i)) continue;
      parts += (parts.empty() ? "" : ", ") + signals.inputs[i].name + " " +
               amount(fit.parts(row, signals.data.inputs[i].source), unit);
    }
    say(people, "  parts     " + parts);
    if (fit.holdout(row) > kMaxResidualShare * fit.holdout_outputs(row))
      say(people, "note        the fit predicts almost nothing of " + signals.outputs[j].name +
                      ": its poles and parts are not those of the machine");
    else if (fit.parts.row(row).maxCoeff() > kMaxPartsOverOutput * fit.holdout_outputs(row))
      say(people, "note        the parts of " + signals.outputs[j].name +
                      " are larger than the output itself: these inputs are correlated and cannot "
                      "be separated");
  }
}

json result_of(const MultivariableArguments& arguments, const Signals& signals,
               const MultivariableFit& fit) {
  json out{{"schema", "servotwin.multivariable/1"},
           {"source", arguments.recording.file.filename().string()},
           {"sample_time_s", signals.data.sample_time_s},
           {"order", fit.order()},
           {"inputs", json::array()},
           {"outputs", json::array()},
           {"poles", json::array()},
           {"trials", json::array()},
           {"break_distances", json()}};
  if (std::isfinite(fit.distances.left_found))
    out["break_distances"] = {{"left_given", fit.distances.left_given},
                              {"left_found", fit.distances.left_found},
                              {"taken", fit.distances.taken}};
  for (std::size_t i = 0; i < signals.inputs.size(); ++i) {
    json one{{"name", signals.inputs[i].name}, {"unit", signals.inputs[i].unit}};
    if (fit.break_distances[i] > 0.0) {
      one["break_distance"] = fit.break_distances[i];
      if (fit.break_deviations[i] > 0.0) one["break_distance_sd"] = fit.break_deviations[i];
    }
    out["inputs"].push_back(one);
  }
  for (const FittedPole& pole : fit.poles) {
    json one{{"frequency_hz", pole.omega / kTwoPi},
             {"frequency_sd_hz", pole.omega_deviation / kTwoPi}};
    if (pole.pair) {
      one["damping"] = pole.zeta;
      one["damping_sd"] = pole.zeta_deviation;
    }
    out["poles"].push_back(one);
  }
  for (const MultivariableTrial& trial : fit.trials)
    out["trials"].push_back(
        {{"order", trial.order}, {"left", number_or_null(trial.left)}, {"chosen", trial.chosen}});
  for (std::size_t j = 0; j < signals.outputs.size(); ++j) {
    const auto row = static_cast<Eigen::Index>(j);
    json coefficients = json::array(), parts = json::object();
    for (std::size_t i = 0; i < signals.inputs.size(); ++i) {
      const Eigen::VectorXd c = fit.coefficients[j].row(static_cast<Eigen::Index>(i)).transpose();
      coefficients.push_back(std::vector<double>(c.begin(), c.end()));
      parts[signals.inputs[i].name] = fit.parts(row, signals.data.inputs[i].source);
    }
    out["outputs"].push_back({{"name", signals.outputs[j].name},
                              {"unit", signals.outputs[j].unit},
                              {"scale", fit.scale(row)},
                              {"rms", fit.holdout_outputs(row)},
                              {"training_rms", fit.training(row)},
                              {"holdout_rms", fit.holdout(row)},
                              {"parts_rms", parts},
                              {"coefficients", coefficients}});
  }
  return out;
}

std::vector<MatVariable> mat_of(const Signals& signals, const MultivariableFit& fit) {
  const MultivariableMatrices m = matrices_of(fit);
  std::vector<std::string> inputs, outputs;
  for (const Signal& input : signals.inputs) inputs.push_back(input.name + " [" + input.unit + "]");
  for (const Signal& output : signals.outputs)
    outputs.push_back(output.name + " [" + output.unit + "]");
  const auto number = [](double value) { return Eigen::MatrixXd::Constant(1, 1, value); };
  return {{"A", m.a},
          {"B", m.b},
          {"C", m.c},
          {"D", m.d},
          {"sample_time_s", number(signals.data.sample_time_s)},
          {"inputs", inputs},
          {"outputs", outputs},
          {"break_distances", Eigen::Map<const Eigen::RowVectorXd>(
                                  fit.break_distances.data(), std::ssize(fit.break_distances))}};
}

/// For every output the measured response, without the share of the frictions, and the fitted one.
std::string bode(const Signals& signals, const MultivariableFit& fit, std::FILE* people) {
  constexpr int kPoints = 400;
  const MultivariableData& data = signals.data;
  std::vector<bool> friction;
  std::vector<std::string> names;
  std::vector<std::size_t> shown;  // inputs that are no friction
  for (std::size_t i = 0; i < signals.inputs.size(); ++i) {
    friction.push_back(signals.inputs[i].channel.name == "friction");
    if (friction.back()) continue;
    shown.push_back(i);
    names.push_back(signals.inputs[i].name);
  }
  std::vector<ResponseRecord> records;
  std::vector<Eigen::MatrixXd> by_friction;
  for (const MultivariableRecord& record : data.records) {
    by_friction.push_back(answer_of(fit, data, record, friction));
    records.emplace_back();
    for (const std::size_t i : shown) records.back().inputs.push_back(record.inputs[i]);
  }
  double rows = 0.0;
  for (const MultivariableRecord& record : data.records)
    rows = std::max(rows, static_cast<double>(record.outputs.front().size()));
  const double from = 4.0 / (rows * data.sample_time_s), to = 0.5 / data.sample_time_s;
  std::vector<PlotPanel> out;
  for (std::size_t j = 0; j < signals.outputs.size(); ++j) {
    const Signal& output = signals.outputs[j];
    for (std::size_t r = 0; r < records.size(); ++r)
      records[r].output =
          data.records[r].outputs[j] - by_friction[r].col(static_cast<Eigen::Index>(j)).array();
    FrequencyResponse measured;
    try {
      measured = frequency_response(records, data.sample_time_s);
    } catch (const std::runtime_error& error) {
      say(people, "note        " + output.name + ": its fit is drawn alone: " + error.what());
    }
    std::vector<ModelledResponse> fits(shown.size());
    for (std::size_t c = 0; c < shown.size(); ++c) {
      fits[c].name = names[c] + ", fit";
      for (int k = 0; k < kPoints; ++k) {
        fits[c].frequency_hz.push_back(from * std::pow(to / from, k / (kPoints - 1.0)));
        fits[c].response.push_back(fit.at(j, shown[c], kTwoPi * fits[c].frequency_hz.back()));
      }
    }
    // The phases and coherences of every output would be three panels for one.
    PlotPanel panel = bode_panels(measured, names, output.name, fits).front();
    panel.title = "to " + output.name;
    panel.y_label = "magnitude [" + output.unit + " per unit of the input]";
    for (const FittedPole& pole : fit.poles) {
      if (pole.pair && pole.zeta < 1.0 && pole.determined())
        panel.marks.push_back(pole.omega / kTwoPi);
    }
    out.push_back(std::move(panel));
  }
  return plot_svg(out);
}

void run(const MultivariableArguments& arguments) {
  if (is_stdout(arguments.matrices))
    throw UsageError("a MATLAB file cannot go to standard output; name a file");
  std::FILE* people = people_beside({arguments.matrices, arguments.plot, arguments.result});
  const Signals signals = read(arguments, people);
  const auto any = [&](const char* name) {
    return std::any_of(signals.inputs.begin(), signals.inputs.end(),
                       [&](const Signal& input) { return input.channel.name == name; });
  };
  if (!arguments.plot.empty() && !any("command") && !any("torque"))
    throw UsageError("--plot: frictions alone have no frequency response; name a command as input");
  MultivariableOptions options = arguments.options;
  options.seek_break_distances = arguments.break_distances.empty() && any("friction");
  say(people, "inputs      " + inputs_text(signals, options.seek_break_distances));
  if (any("torque"))
    say(people,
        "note        a torque in a closed loop contains the noise of the encoder, which biases the "
        "result");
  MultivariableFit fit;
  try {
    const Progress progress("fitting");
    fit = identify_multivariable(signals.data, options);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(arguments.recording.file.string() + ": " + error.what());
  }
  say_fit(people, signals, fit, options.seek_break_distances);
  if (!arguments.result.empty()) write_json(arguments.result, result_of(arguments, signals, fit));
  if (!arguments.matrices.empty()) write_mat(arguments.matrices, mat_of(signals, fit));
  if (!arguments.plot.empty()) write_result(arguments.plot, bode(signals, fit, people));
  say_written(people, {arguments.result, arguments.matrices, arguments.plot});
}

}  // namespace

Command add_multivariable(CLI::App& app) {
  const auto arguments = std::make_shared<MultivariableArguments>();
  OptionTable command(app, "multivariable",
                      "Identifies all axes together: their common modes, and the share of "
                      "every command and friction in every error.");
  arguments->recording.declare(command, "REC", kRecordingHelp);
  command
      .option("--input", arguments->inputs,
              "list of AXIS.command (its velocity), AXIS.friction, AXIS.torque (default: "
              "command and friction of every axis that moves)")
      .takes("NAME,..");
  command
      .option("--output", arguments->outputs,
              "list of AXIS.error, AXIS.velocity, AXIS.torque (default: the error of every "
              "axis that moves)")
      .takes("NAME,..");
  command
      .option(
          "--break-distance", arguments->break_distances,
          std::string(
              "each friction is one Maxwell element per distance of this list, within which the "
              "element goes from rest to sliding [um | urad] (default: searched for from ") +
              kBreakDistances + ")")
      .takes("UM,..");
  command
      .option("--order", arguments->options.order,
              "number of poles (default: chosen on held-out data)")
      .takes("N")
      .between(1, kMaxPoles);
  command
      .option("--mat", arguments->matrices,
              "write the fit as continuous state-space matrices (MATLAB v5)")
      .takes("OUT.mat");
  command
      .option(
          "--plot", arguments->plot,
          "write a plot of the responses to all commands and torques to this file (SVG): "
          "magnitudes as fitted, and as measured with their 95 % band where that is significant")
      .takes("OUT.svg");
  command
      .option("--json", arguments->result,
              "write the complete result to this file; - is standard output")
      .takes("OUT");
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
