// servotwin frequency-response: the frequency response of an axis, and its vibration modes.
#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/common/command.h"
#include "cli/common/option_table.h"
#include "cli/common/output.h"
#include "cli/common/response_options.h"
#include "diagnosis/report/bode.h"
#include "identification/response/response_modes.h"
#include "twin/two_pi.h"

namespace servotwin::cli {
namespace {

using nlohmann::json;

constexpr double kMinCoherence = 0.8;  // of the bands that are printed
constexpr int kMaxPrintedBands = 5;
constexpr double kExcitedShare = 0.999;   // of the power of an input
constexpr double kMinLinesPerMode = 4.0;  // across its half-power width, to resolve its damping
constexpr double kMinUsefulNyquist_hz = 50.0;  // modes of drives are usually above it
constexpr double kMaxMisfit = 4.0;  // above: the order is too low, or the axis is not linear
constexpr Eigen::Index kMinLinesOfBand = 3, kMaxGapInBand_lines = 2;

struct FrequencyResponseArguments {
  ResponseOptions input;
  std::filesystem::path result, plot;
  ModeOptions options;
};

/// "0.98 to 38.1 Hz, 52 to 60.5 Hz": the bands in which `holds` is true at several adjacent
/// frequencies.
std::string bands(const Eigen::ArrayXd& hz, const Eigen::Array<bool, Eigen::Dynamic, 1>& holds) {
  std::string out;
  int count = 0;
  for (Eigen::Index i = 0; i < hz.size();) {
    if (!holds(i)) {
      ++i;
      continue;
    }
    Eigen::Index last = i;
    for (Eigen::Index k = i; k < hz.size() && k - last <= kMaxGapInBand_lines + 1; ++k) {
      if (holds(k)) last = k;
    }
    if (last - i + 1 >= kMinLinesOfBand && ++count <= kMaxPrintedBands)
      out += (out.empty() ? "" : ", ") + text("%.4g to %.4g Hz", hz(i), hz(last));
    i = last + 1;
  }
  if (count > kMaxPrintedBands) out += text(" and %d more", count - kMaxPrintedBands);
  return out.empty() ? "nowhere" : out;
}

void say_response(std::FILE* people, const ResponseSignals& signals,
                  const FrequencyResponse& response) {
  say(people, text("averages    %d windows of %.4g s, equivalent to %.1f independent ones; "
                   "frequencies %.4g Hz apart, up to %.4g Hz",
                   response.windows, response.window_s, response.averages, 1.0 / response.window_s,
                   0.5 / response.sample_time_s));
  if (const double highest = 0.5 / response.sample_time_s; highest < kMinUsefulNyquist_hz)
    say(people, text("note        at %.4g rows per second, nothing above %.4g Hz can be measured; "
                     "vibration modes of drives are usually higher",
                     2.0 * highest, highest));
  for (std::size_t i = 0; i < response.channels.size(); ++i) {
    const ResponseChannel& channel = response.channels[i];
    say(people, "response    " + signals.inputs[i] + " to " + signals.output);
    double power = 0.0;
    Eigen::Index k = 0;
    while (k + 1 < channel.power.size() && (power += channel.power(k)) < kExcitedShare) ++k;
    say(people, channel.power.sum() > 0.0
                    ? text("  excited   %.4g %% of the input's power%s is below %.4g Hz",
                           100.0 * kExcitedShare, signals.differenced ? " as a velocity" : "",
                           response.frequency_hz(k))
                    : std::string("  excited   not at all: the input is constant"));
    say(people, text("  coherent  above %.1f: ", kMinCoherence) +
                    bands(response.frequency_hz, channel.coherence > kMinCoherence));
    say(people, "  significant: " + bands(response.frequency_hz, channel.significant));
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
    say(people, "order       squared error on held-out windows, in standard deviations: " + tried);
  }
  say(people, text("fit         order %d through %zu frequencies from %.4g to %.4g Hz, squared "
                   "error %.3g standard deviations",
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
    narrow = narrow || (pole.pair && 2.0 * pole.zeta * hz < kMinLinesPerMode / response.window_s);
  }
  if (!found.declined.empty()) say(people, "declined    " + found.declined);
  if (!open.empty())
    say(people,
        "note        not determined by these data (+- beyond a third of the value): poles at " +
            open);
  if (narrow)
    say(people,
        text("note        a mode is narrower than %.0f frequency lines: the windows broaden it, so "
             "its damping is at most the value above; use longer windows (--window)",
             kMinLinesPerMode));
  if (fit.misfit > kMaxMisfit)
    say(people,
        "note        the residual of the fit exceeds the random scatter: friction or another "
        "nonlinearity, a delay (--delay), or too low an order; +- is widened accordingly");
}

std::string bode(const ResponseSignals& signals, const FittedResponse& found) {
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
  std::vector<PlotPanel> panels =
      bode_panels(found.response, signals.inputs, signals.output, {fit});
  if (found.fit) {
    for (const FittedPole& pole : found.fit->poles) {
      if (pole.pair && pole.zeta < 1.0 && pole.determined())
        panels.front().marks.push_back(pole.omega / kTwoPi);
    }
  }
  return plot_svg(panels);
}

json result_of(const FrequencyResponseArguments& arguments, const ResponseSignals& signals,
               const FittedResponse& found) {
  const FrequencyResponse& response = found.response;
  const auto list = [](const auto& values) {
    return json(std::vector<double>(values.begin(), values.end()));
  };
  json out{{"schema", "servotwin.frequency-response/1"},
           {"source", arguments.input.recording.file.filename().string()},
           {"axis", signals.axis.empty() ? json() : json(signals.axis)},
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

void run(const FrequencyResponseArguments& arguments) {
  std::FILE* people = people_beside({arguments.result, arguments.plot});
  const ResponseSignals signals = arguments.input.read(people);
  ModeOptions options = arguments.options;
  options.spectra.differenced = signals.differenced;
  FittedResponse found;
  try {
    const Progress progress("fitting " + signals.output);
    found = fit_response(signals.records, signals.sample_time_s, options);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(arguments.input.recording.file.string() + ": " + error.what());
  }
  say_response(people, signals, found.response);
  say_fit(people, found);
  if (!arguments.plot.empty()) write_result(arguments.plot, bode(signals, found));
  if (!arguments.result.empty()) write_json(arguments.result, result_of(arguments, signals, found));
  say_written(people, {arguments.plot, arguments.result});
}

}  // namespace

Command add_frequency_response(CLI::App& app) {
  const auto arguments = std::make_shared<FrequencyResponseArguments>();
  OptionTable command(app, "frequency-response",
                      "Estimates the frequency response of an axis, and its vibration modes.");
  arguments->input.declare(command);
  command
      .option("--window", arguments->options.spectra.window_s,
              text("length of the windows that are averaged [s] (default: an eighth of the "
                   "data, at most %g): longer windows resolve more, more windows scatter less",
                   kWindow_s))
      .takes("S")
      .positive();
  command
      .option("--order", arguments->options.order,
              "number of poles (default: chosen on held-out windows)")
      .takes("N")
      .between(1, kMaxPoles);
  command
      .option("--delay", arguments->options.delay_s,
              "delay of the output that is removed before the fit [s]")
      .takes("S")
      .between(0.0, 1.0);
  command
      .option("--json", arguments->result,
              "write the complete result to this file; - is standard output")
      .takes("OUT");
  command
      .option("--plot", arguments->plot,
              "write the Bode plot with its 95 % band to this file (SVG)")
      .takes("OUT.svg");
  return {command.app(), [arguments] { run(*arguments); }};
}

}  // namespace servotwin::cli
