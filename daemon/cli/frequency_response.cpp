// servotwin frequency-response: how an axis answers at every frequency, and its modes.
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "daemon/cli/command.h"
#include "daemon/cli/options.h"
#include "daemon/cli/output.h"
#include "diagnosis/bode.h"
#include "drivers/text.h"
#include "identification/response_modes.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

constexpr double kTwoPi = 2.0 * std::numbers::pi;
constexpr double kCoherent = 0.8;
constexpr double kMostPower = 0.999;
constexpr double kResolved = 4.0;  // lines across the half-power width of a mode
constexpr double kSlow_hz = 50.0;
constexpr double kMisfit = 4.0;  // beyond it the order or the linearity is not enough
constexpr Eigen::Index kFewestLines = 3, kWidestHole = 2;  // of a band

struct Arguments {
  RecordingOptions recording;
  std::string axis;
  std::vector<std::string> inputs, outputs;
  std::filesystem::path result, plot;
  ModeOptions options;
};

std::vector<std::string> parts_of(const std::string& list) { return split_fields(list, ','); }

/// Inputs, output and instruments of one repetition, and how they are called.
struct Signals {
  std::vector<std::string> inputs;
  std::string output;
  std::vector<ResponseRecord> records;
  bool differenced = false;
};

/// The unbroken parts in which every signal has a value.
void add_finite(const ResponseRecord& whole, std::vector<ResponseRecord>& out) {
  const auto all = [&](const auto& visit) {
    for (const Eigen::ArrayXd& x : whole.inputs) visit(x);
    visit(whole.output);
    for (const Eigen::ArrayXd& x : whole.instruments) visit(x);
  };
  const auto finite = [&](Eigen::Index i) {
    bool out_of = true;
    all([&](const Eigen::ArrayXd& x) { out_of = out_of && std::isfinite(x(i)); });
    return out_of;
  };
  for (Eigen::Index begin = 0; begin < whole.output.size();) {
    Eigen::Index end = begin;
    while (end < whole.output.size() && finite(end)) ++end;
    if (end > begin) {
      const auto cut = [&](const std::vector<Eigen::ArrayXd>& from) {
        std::vector<Eigen::ArrayXd> to;
        for (const Eigen::ArrayXd& x : from) to.push_back(x.segment(begin, end - begin));
        return to;
      };
      out.push_back(
          {cut(whole.inputs), whole.output.segment(begin, end - begin), cut(whole.instruments)});
    }
    begin = end + 1;
  }
}

/// "torque" of the axis, or "Y.command" of another one.
struct Channel {
  std::string axis, name;
};

Channel channel_of(const std::string& given, const std::string& axis) {
  const std::size_t point = given.rfind('.');
  Channel out = point == std::string::npos
                    ? Channel{axis, given}
                    : Channel{given.substr(0, point), given.substr(point + 1)};
  const std::vector<std::string> known{"command", "position", "error", "torque"};
  if (std::find(known.begin(), known.end(), out.name) == known.end()) {
    throw UsageError(in_quotes(given) + " is none of " + listed(known) +
                     ", of --axis or as AXIS.channel" + did_you_mean(out.name, known));
  }
  return out;
}

/// Channels of axes. A torque is an input with the axis' command as its instrument: the position
/// loop feeds the noise of the position back into it.
double axis_signals(const Arguments& arguments, Signals& out, std::FILE* people) {
  const Recording whole = arguments.recording.read(people);
  out.inputs = arguments.inputs.empty() ? std::vector<std::string>{"command"}
                                        : parts_of(arguments.inputs.front());
  out.output = arguments.outputs.empty() ? "position" : arguments.outputs.front();
  std::vector<SegmentedAxis> axes;
  const auto segmented = [&](const std::string& name) -> const SegmentedAxis& {
    for (const SegmentedAxis& axis : axes) {
      if (axis.axis == name) return axis;
    }
    axes.push_back(segment_axis(whole, name));
    for (const std::string& line : axes.back().report.lines()) say(people, line);
    return axes.back();
  };
  axes.reserve(out.inputs.size() + 2);
  const SegmentedAxis& own = segmented(arguments.axis);
  const auto values = [&](const Channel& channel, std::size_t i) -> Eigen::ArrayXd {
    const SegmentedAxis& axis = segmented(channel.axis);
    const auto refuse = [&](const std::string& why) {
      throw std::runtime_error(axis.source + ": " + channel.axis + " has no " + why);
    };
    if (axis.segments.size() != own.segments.size() ||
        axis.segments[i].size() != own.segments[i].size() ||
        axis.segments[i].start_s != own.segments[i].start_s)
      refuse("rows at the same times as " + own.axis +
             "; take an unbroken part with --from and --to");
    const Segment& segment = axis.segments[i];
    if (channel.name == "command") return segment.command;
    if (channel.name == "torque") {
      if (segment.torque.size() == 0) refuse("torque");
      return segment.torque;
    }
    if (segment.actual.size() == 0) refuse("encoder values");
    if (channel.name == "position") return segment.actual;
    return segment.command - segment.actual;
  };
  const Channel output = channel_of(out.output, arguments.axis);
  bool fed_back = false;
  for (const std::string& name : out.inputs) {
    const Channel input = channel_of(name, arguments.axis);
    if (input.axis == output.axis && input.name == output.name)
      throw UsageError("--input and --output are both " + in_quotes(name));
    fed_back = fed_back || input.name != "command";
  }
  for (std::size_t i = 0; i < own.segments.size(); ++i) {
    ResponseRecord record;
    for (const std::string& name : out.inputs) {
      const Channel input = channel_of(name, arguments.axis);
      record.inputs.push_back(values(input, i));
      if (fed_back) record.instruments.push_back(values({input.axis, "command"}, i));
    }
    record.output = values(output, i);
    add_finite(record, out.records);
  }
  if (fed_back)
    say(people,
        "closed loop: the command is the instrument, so that what feedback brings into the input "
        "has no share");
  out.differenced = true;
  return own.sample_time_s;
}

/// Columns of a file as they are, one record per --input and --output.
double column_signals(const Arguments& arguments, Signals& out, std::FILE* people) {
  if (arguments.inputs.empty() || arguments.inputs.size() != arguments.outputs.size())
    throw UsageError(
        "give --axis, or columns of the file as --input and --output, one of each per repetition");
  RecordingOptions recording = arguments.recording;
  if (!recording.read_options.columns.empty())
    throw UsageError("--columns needs --axis; without it --input and --output name the columns");
  std::vector<std::vector<std::string>> names;
  for (std::size_t i = 0; i < arguments.inputs.size(); ++i) {
    const std::vector<std::string> inputs = parts_of(arguments.inputs[i]);
    if (inputs.size() != parts_of(arguments.inputs.front()).size())
      throw UsageError("--input has not the same number of columns every time");
    names.emplace_back();
    for (const std::string& input : inputs) {
      names.back().push_back(input + " to " + arguments.outputs[i]);
      // Their unit is left to who reads the response: a factor of one.
      recording.read_options.columns += (i == 0 && names.back().size() == 1 ? "" : ",") +
                                        names.back().back() + ".command=" + input + "[m]," +
                                        names.back().back() + ".actual=" + arguments.outputs[i] +
                                        "[m]";
    }
  }
  const Recording whole = recording.read(people);
  double h = 0.0;
  for (const std::vector<std::string>& repetition : names) {
    std::vector<SegmentedAxis> axes;
    for (const std::string& name : repetition) axes.push_back(segment_axis(whole, name));
    for (const std::string& line : axes.front().report.lines()) say(people, line);
    h = axes.front().sample_time_s;
    for (std::size_t i = 0; i < axes.front().segments.size(); ++i) {
      ResponseRecord record;
      record.output = axes.front().segments[i].actual;
      for (const SegmentedAxis& axis : axes) {
        if (axis.segments.size() != axes.front().segments.size() ||
            axis.segments[i].size() != record.output.size())
          throw std::runtime_error(axis.source + ": the inputs have no values in the same rows");
        record.inputs.push_back(axis.segments[i].command);
      }
      add_finite(record, out.records);
    }
  }
  out.inputs = parts_of(arguments.inputs.front());
  out.output = arguments.outputs.front();
  return h;
}

/// "0.98 to 38.1 Hz, 52 to 60.5 Hz": where it holds at several lines on end.
std::string bands(const Eigen::ArrayXd& hz, const Eigen::Array<bool, Eigen::Dynamic, 1>& holds) {
  std::string out;
  for (Eigen::Index i = 0; i < hz.size();) {
    if (!holds(i)) {
      ++i;
      continue;
    }
    Eigen::Index last = i;
    for (Eigen::Index k = i; k < hz.size() && k - last <= kWidestHole + 1; ++k) {
      if (holds(k)) last = k;
    }
    if (last - i + 1 >= kFewestLines)
      out += (out.empty() ? "" : ", ") + text("%.4g to %.4g Hz", hz(i), hz(last));
    i = last + 1;
  }
  return out.empty() ? "nowhere" : out;
}

void say_response(std::FILE* people, const Signals& signals, const FrequencyResponse& response) {
  say(people, text("averages    %d windows of %.4g s, as good as %.1f independent ones; %.4g Hz "
                   "apart, up to %.4g Hz",
                   response.windows, response.window_s, response.averages, 1.0 / response.window_s,
                   0.5 / response.sample_time_s));
  if (const double highest = 0.5 / response.sample_time_s; highest < kSlow_hz)
    say(people,
        text("note        at %.4g rows per second nothing above %.4g Hz is seen; modes of drives "
             "lie higher",
             2.0 * highest, highest));
  for (std::size_t i = 0; i < response.channels.size(); ++i) {
    const ResponseChannel& channel = response.channels[i];
    say(people, "response    " + signals.inputs[i] + " to " + signals.output);
    double power = 0.0;
    Eigen::Index k = 0;
    while (k + 1 < channel.power.size() && (power += channel.power(k)) < kMostPower) ++k;
    say(people,
        text("  excited   %.4g %% of the input's power%s is below %.4g Hz", 100.0 * kMostPower,
             signals.differenced ? " as a velocity" : "", response.frequency_hz(k)));
    say(people, text("  coherent  above %.1f: ", kCoherent) +
                    bands(response.frequency_hz, channel.coherence > kCoherent));
    say(people, "  beyond chance: " + bands(response.frequency_hz, channel.significant));
  }
}

void say_fit(std::FILE* people, const FittedResponse& found) {
  if (!found.fit) {
    say(people, "declined    no fit: " + found.declined);
    return;
  }
  const FrequencyResponse& response = found.response;
  const RationalFit& fit = *found.fit;
  if (!found.trials.empty()) {
    std::string tried;
    for (const OrderTrial& trial : found.trials)
      tried += text("%s%d%s %.3g", tried.empty() ? "" : ", ", trial.order,
                    trial.chosen ? " ->" : "", trial.held_out);
    say(people, "order       squared error on unseen windows, in deviations: " + tried);
  }
  say(people, text("fit         order %d through %zu frequencies from %.4g to %.4g Hz, squared "
                   "error %.3g deviations",
                   fit.order(), found.fitted.size(), response.frequency_hz(found.fitted.front()),
                   response.frequency_hz(found.fitted.back()), fit.misfit));
  bool narrow = false;
  std::string open;
  for (const FittedPole& pole : fit.poles) {
    const double hz = pole.omega / kTwoPi;
    if (!pole.determined()) {
      open += text("%s%.4g Hz", open.empty() ? "" : ", ", hz);
      continue;
    }
    std::string line = text("%s %.4g +- %.2g Hz",
                            !pole.pair        ? "real pole  "
                            : pole.zeta < 1.0 ? "mode       "
                                              : "real pair  ",
                            hz, pole.omega_deviation / kTwoPi);
    if (pole.pair) line += text(", damping %.4g +- %.2g", pole.zeta, pole.zeta_deviation);
    say(people, line + text(", explains %.3g %%", 100.0 * pole.explains));
    narrow = narrow || (pole.pair && 2.0 * pole.zeta * hz < kResolved / response.window_s);
  }
  if (!found.declined.empty()) say(people, "declined    " + found.declined);
  if (!open.empty())
    say(people,
        "note        not determined by these data (+- beyond a third of the value): poles at " +
            open);
  if (narrow)
    say(people, text("note        a mode is narrower than %.0f lines: the windows widen it, and "
                     "its damping is at most what is said; take longer ones with --window",
                     kResolved));
  if (fit.misfit > kMisfit)
    say(people,
        "note        the fit leaves more than the scatter: friction and other nonlinearity, a "
        "delay (--delay), or too low an order; +- has been widened for it");
}

std::string bode(const Signals& signals, const FittedResponse& found) {
  constexpr int kPoints = 600;
  ModelledResponse fit;
  if (found.fit) {
    const double from = found.response.frequency_hz(found.fitted.front()),
                 to = found.response.frequency_hz(found.fitted.back());
    fit.name = "fit";
    for (int i = 0; i < kPoints; ++i) {
      fit.frequency_hz.push_back(from * std::pow(to / from, i / (kPoints - 1.0)));
      fit.response.push_back(found.fit->at(0, kTwoPi * fit.frequency_hz.back()));
    }
  }
  std::vector<PlotPanel> panels = bode_panels(found.response, signals.inputs, signals.output, fit);
  if (found.fit) {
    for (const FittedPole& pole : found.fit->poles) {
      if (pole.pair && pole.zeta < 1.0 && pole.determined())
        panels.front().marks.push_back(pole.omega / kTwoPi);
    }
  }
  return plot_svg(panels);
}

json result_of(const Arguments& arguments, const Signals& signals, const FittedResponse& found) {
  const FrequencyResponse& response = found.response;
  const auto list = [](const auto& values) {
    return json(std::vector<double>(values.begin(), values.end()));
  };
  json out{{"schema", "servotwin.frequency-response/1"},
           {"source", arguments.recording.file.filename().string()},
           {"axis", arguments.axis.empty() ? json() : json(arguments.axis)},
           {"output", signals.output},
           {"sample_time_s", response.sample_time_s},
           {"window_s", response.window_s},
           {"windows", response.windows},
           {"averages", response.averages},
           {"frequency_hz", list(response.frequency_hz)},
           {"coherence", list(response.coherence)},
           {"responses", json::array()},
           {"fit", json()},
           {"declined", found.declined.empty() ? json() : json(found.declined)}};
  for (std::size_t i = 0; i < response.channels.size(); ++i) {
    const ResponseChannel& channel = response.channels[i];
    const Eigen::ArrayXd real = channel.response.real(), imag = channel.response.imag();
    out["responses"].push_back({{"input", signals.inputs[i]},
                                {"real", list(real)},
                                {"imag", list(imag)},
                                {"sd", list(channel.deviation)},
                                {"coherence", list(channel.coherence)},
                                {"significant", std::vector<bool>(channel.significant.begin(),
                                                                  channel.significant.end())}});
  }
  if (!found.fit) return out;
  json poles = json::array(), trials = json::array();
  for (const FittedPole& pole : found.fit->poles) {
    json one{{"frequency_hz", pole.omega / kTwoPi},
             {"frequency_sd_hz", pole.omega_deviation / kTwoPi},
             {"explains", pole.explains}};
    if (pole.pair) {
      one["damping"] = pole.zeta;
      one["damping_sd"] = pole.zeta_deviation;
    }
    poles.push_back(one);
  }
  for (const OrderTrial& trial : found.trials)
    trials.push_back(
        {{"order", trial.order}, {"held_out", trial.held_out}, {"chosen", trial.chosen}});
  out["fit"] = {{"order", found.fit->order()},
                {"from_hz", response.frequency_hz(found.fitted.front())},
                {"to_hz", response.frequency_hz(found.fitted.back())},
                {"frequencies", found.fitted.size()},
                {"misfit", found.fit->misfit},
                {"delay_s", found.fit->delay_s},
                {"poles", poles},
                {"trials", trials}};
  return out;
}

void run(const Arguments& arguments) {
  std::FILE* people = people_beside({arguments.result, arguments.plot});
  if (!arguments.axis.empty() && (arguments.inputs.size() > 1 || arguments.outputs.size() > 1))
    throw UsageError("with --axis, --input and --output are given once; several inputs are a list");
  Signals signals;
  const double h = arguments.axis.empty() ? column_signals(arguments, signals, people)
                                          : axis_signals(arguments, signals, people);
  ModeOptions options = arguments.options;
  options.spectra.differenced = signals.differenced;
  FittedResponse found;
  try {
    const Progress progress("fitting " + signals.output);
    found = fit_response(signals.records, h, options);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(arguments.recording.file.string() + ": " + error.what());
  }
  say_response(people, signals, found.response);
  say_fit(people, found);
  if (!arguments.plot.empty()) write_result(arguments.plot, bode(signals, found));
  if (!arguments.result.empty()) write_json(arguments.result, result_of(arguments, signals, found));
}

}  // namespace

Command add_frequency_response(CLI::App& app) {
  const auto arguments = std::make_shared<Arguments>();
  CLI::App& command = *app.add_subcommand("frequency-response",
                                          "How an axis answers at every frequency, and its modes.");
  arguments->recording.declare(command, "REC",
                               "recording: CSV with units, foreign CSV with --columns or named "
                               "columns, MATLAB .mat, or a CAN log with --can-map");
  command
      .add_option("--axis", arguments->axis,
                  "axis of the recording (default: --input and --output name columns)")
      ->type_name("X");
  command
      .add_option("--input", arguments->inputs,
                  "command (default), torque, or of another axis Y.command; a list A,B tells them "
                  "apart; without --axis a column, once per repetition")
      ->type_name("NAME")
      ->expected(1)
      ->take_all();
  command
      .add_option("--output", arguments->outputs,
                  "position (default), error or torque; without --axis a column, once per "
                  "repetition")
      ->type_name("NAME")
      ->expected(1)
      ->take_all();
  command
      .add_option("--window", arguments->options.spectra.window_s,
                  text("length of the windows that are averaged [s] (default: an eighth of the "
                       "data, at most %g): longer resolve more, more of them scatter less",
                       kWindow_s))
      ->type_name("S")
      ->check(CLI::PositiveNumber.name(""));
  command
      .add_option("--order", arguments->options.order,
                  "number of poles (default: what windows say that the fit has not seen)")
      ->type_name("N")
      ->check(between(1, kMostPoles));
  command
      .add_option("--delay", arguments->options.delay_s,
                  "delay of the output that is taken out before the fit [s]")
      ->type_name("S")
      ->check(between(0.0, 1.0));
  command
      .add_option("--json", arguments->result, "write the whole result here; - is standard output")
      ->type_name("OUT");
  command
      .add_option("--plot", arguments->plot, "write the Bode plot with its 95 % band here (SVG)")
      ->type_name("OUT.svg");
  return {&command, [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
