#include "diagnosis/report/report.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <stdexcept>
#include <string_view>

#include "diagnosis/report/bode.h"
#include "diagnosis/report/cause_picture.h"
#include "diagnosis/report/cause_words.h"
#include "diagnosis/report/diagnosis_file.h"
#include "diagnosis/report/in_short.h"
#include "diagnosis/report/plot.h"
#include "diagnosis/report/torque_text.h"
#include "diagnosis/statistics/text.h"
#include "twin/shown_units.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

// A Bode plot with fewer significant frequencies is not shown.
constexpr std::size_t kMinBodeFrequencies = 12;
// Length of held-out data that the error plot shows, from the middle of the hold-out.
constexpr double kErrorPlotLength_s = 4.0;

constexpr const char* kStyle =
    ":root{color-scheme:light dark;--line:#8884;--soft:#8881}"
    "body{font:16px/1.5 sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem}"
    "table{border-collapse:collapse;display:block;overflow-x:auto}"  // not wider than the page
    "code{overflow-wrap:anywhere}td,th{padding:.3rem .8rem;text-align:left;"
    "border-bottom:1px solid var(--line);vertical-align:top}"
    "svg{max-width:100%;height:auto;border-radius:.3rem}"
    ".verdict{font-size:1.25rem;border-left:.3rem solid #3b7dd8;padding:.2rem 1rem}"
    ".facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(16rem,1fr));gap:0 2rem}"
    ".facts h2{font-size:1rem;margin:.5rem 0}.facts p,.facts ol{margin:.3rem 0}"
    ".facts ol{padding-left:1.2rem}"
    ".size{font-size:1.1rem}figure{margin:1rem 0}figcaption{opacity:.8}"
    "details{border-top:1px solid var(--line);padding:.6rem 0}"
    "summary{cursor:pointer;font-size:1.1rem;font-weight:bold}"
    "pre{overflow:auto}";

std::string spaced(std::string_view id) {
  std::string out(id);
  std::replace(out.begin(), out.end(), '_', ' ');
  return out;
}

/// A part that is closed until the reader opens it. `title` is HTML.
std::string folded(const std::string& title, const std::string& content) {
  return "<details><summary>" + title + "</summary>\n" + content + "</details>\n";
}

std::string row(const char* name, const std::string& cell) {
  return std::string("<tr><th>") + name + "</th><td>" + cell + "</td></tr>\n";
}

/// The simulation error of baseline and extended model over a few seconds of the hold-out, with the
/// measured tracking error beside it.
std::string error_figure(const Diagnosis& diagnosis, const std::vector<Segment>& segments) {
  const bool rotary = diagnosis.baseline.rotary;
  const std::vector<Segment> holdout = held_out(segments, diagnosis.baseline.training_to_s + 1e-9);
  if (holdout.empty()) return {};
  const Segment& s = holdout.front();
  const Eigen::ArrayXd error = s.command - s.actual;
  const Eigen::ArrayXd before = 1e6 * (error - simulate(diagnosis.baseline.model, s)),
                       after = 1e6 * (error - simulate(diagnosis.extended.model, s));
  const auto count = std::min<Eigen::Index>(
      s.size() - s.lead,
      static_cast<Eigen::Index>(std::lround(kErrorPlotLength_s / s.sample_time_s)));
  const Eigen::Index begin = s.lead + (s.size() - s.lead - count) / 2;
  PlotSeries measured{"measured", {}, {}, true, ""},
      baseline{"baseline model", {}, {}, true, "#d9542b"},
      extended{"extended model", {}, {}, true, "#2f9e58"};
  for (Eigen::Index k = begin; k < begin + count; ++k) {
    const double t = s.start_s + s.sample_time_s * static_cast<double>(k);
    measured.x.push_back(t);
    measured.y.push_back(1e6 * error(k));
    baseline.x.push_back(t);
    baseline.y.push_back(before(k));
    extended.x.push_back(t);
    extended.y.push_back(after(k));
  }
  const std::string unit = rotary ? "error [urad]" : "error [um]";
  return "<figure>" +
         plot_svg({{"tracking error (command minus encoder)",
                    "time in the recording [s]",
                    unit,
                    false,
                    {measured}},
                   {"simulation error (measured minus simulated)",
                    "time in the recording [s]",
                    unit,
                    false,
                    {baseline, extended}}}) +
         "<figcaption>A few seconds of held-out data, which no fit has used."
         "</figcaption></figure>\n";
}

/// The frequency response from command to position: as measured, and as estimated in the same way
/// from the extended model's simulation of the same motion, so that friction acts on both alike.
/// Empty where the recording is too short or has too few significant frequencies.
std::string frequency_section(const Diagnosis& diagnosis, const std::vector<Segment>& segments) {
  std::vector<ResponseRecord> measured, simulated;
  for (const Segment& s : segments) {
    measured.push_back({{s.command}, s.actual, {}});
    simulated.push_back({{s.command}, s.command - simulate(diagnosis.extended.model, s), {}});
  }
  FrequencyResponse machine, twin;
  try {
    const double h = diagnosis.extended.model.sample_time_s;
    machine = frequency_response(measured, h, {.differenced = true});
    twin = frequency_response(simulated, h, {.differenced = true});
  } catch (const std::runtime_error&) {
    return {};  // too short
  }
  const std::vector<Eigen::Index> places = machine.significant(0, 0.0, 0.5 / machine.sample_time_s);
  if (places.size() < kMinBodeFrequencies) return {};
  ModelledResponse model{"the twin", {}, {}};
  for (const Eigen::Index i : places) {
    model.frequency_hz.push_back(machine.frequency_hz(i));
    model.response.push_back(twin.channels[0].response(i));
  }
  return folded(
      "Frequency response",
      "<figure>" + plot_svg(bode_panels(machine, {"command"}, "position", {model})) +
          text("<figcaption>From command to position, averaged over %d windows of %.3g s. "
               "Frequencies whose coherence could be chance are not drawn. A peak that the twin "
               "lacks is an unmodelled mode of vibration: see <code>servotwin "
               "frequency-response</code>."
               "</figcaption></figure>\n",
               machine.windows, machine.window_s));
}

/// The confidence of a cause and the figures that it is computed from.
std::string confidence_text(const Cause& cause, double unexplained_share, const char* unit) {
  if (!cause.counts.empty()) return "counted in the recording, not estimated";
  std::string out =
      cause.confidence >= 0.995 ? "over 99 %" : text("%.0f %%", 100.0 * cause.confidence);
  out += text(
      "; it explains more than its nearest rival that acts by a law in %.0f %% of the bootstrap "
      "resamples, and all "
      "causes together explain %.0f %% of the simulation error above the noise floor; a cause that "
      "removes a smaller share of the error is rated lower",
      100.0 * cause.wins, 100.0 * (1.0 - unexplained_share));
  if (std::isfinite(cause.gain.low)) {
    out += cause.gain.low > 0.0
               ? text(
                     "; on held-out data it lowers the error by %.2g to %.2g %s (95 %% "
                     "confidence interval)",
                     1e6 * cause.gain.low, 1e6 * cause.gain.high, unit)
               : text(
                     "; its gain on held-out data may be chance (95 %% confidence interval %.2g "
                     "to %.2g %s)",
                     1e6 * cause.gain.low, 1e6 * cause.gain.high, unit);
  }
  return out + ".";
}

/// A picture that shows the cause, if there is one.
std::string figure_of(const Diagnosis& diagnosis, const Cause& cause,
                      const std::vector<Segment>& segments) {
  const CausePicture picture = picture_of(diagnosis, cause, segments);
  if (picture.panels.empty()) return {};
  return "<figure>" + plot_svg(picture.panels) + "<figcaption>" + escaped(picture.caption) +
         " Points are measured values; bars are 95 % confidence intervals of means."
         "</figcaption></figure>\n";
}

std::string section_of(const Diagnosis& diagnosis, std::size_t number,
                       const std::vector<Segment>& segments) {
  const Cause& cause = diagnosis.causes[number];
  const char* unit = micro(diagnosis.baseline.rotary);
  std::string out = "<p class='size'>" + escaped(plain_size(diagnosis, cause)) + "</p>\n";
  // That of the first cause is on the first screen.
  if (number > 0) out += figure_of(diagnosis, cause, segments);
  out += "<table>";
  if (const std::string advice = advice_for(diagnosis, cause); !advice.empty())
    out += row("check on the machine", escaped(advice));
  out += row("about this cause", "<code>" + page_to_read(cause.id) + "</code>");
  if (std::isfinite(cause.gain.before))
    out += row("simulation error",
               text("%.3g %s RMS without this cause in the model, %.3g %s RMS with it",
                    1e6 * cause.gain.before, unit, 1e6 * cause.gain.after, unit));
  const Gain& gain = cause.gain;
  if (worth_a_repair(gain)) {
    std::string repair = text("tracking error %.4g %s RMS instead of %.4g",
                              1e6 * gain.tracking_repaired, unit, 1e6 * gain.tracking_now);
    if (std::isfinite(gain.contour_repaired))
      repair += text(", across the path %.4g instead of %.4g", 1e6 * gain.contour_repaired,
                     1e6 * gain.contour_now);
    out += row("expected from a repair", repair + " (simulated)");
  }
  out += row("confidence", confidence_text(cause, diagnosis.unexplained_share, unit));
  if (!cause.ambiguous_with.empty()) {
    std::string rivals;
    for (const std::string& rival : cause.ambiguous_with)
      rivals += (rivals.empty() ? "" : "; ") + escaped(plain_name(rival));
    out += row("it may also be", rivals + ": this recording does not distinguish them");
  }
  out += row("in the model",
             "<code>" + escaped(cause.id) + "</code>: " + escaped(cause_text(diagnosis, cause)));
  return folded(text("%zu. ", number + 1) + escaped(plain_name(diagnosis, cause)),
                out + "</table>\n");
}

/// What to check, in the order of what the causes explain.
std::string checks_of(const Diagnosis& diagnosis) {
  std::string out;
  for (const Cause& cause : diagnosis.causes) {
    if (const std::string advice = advice_for(diagnosis, cause); !advice.empty())
      out += "<li>" + escaped(advice) + " <small>(" + escaped(plain_name(diagnosis, cause)) +
             ")</small></li>\n";
  }
  return out.empty()
             ? out
             : "<div><h2>Check on the machine, in this order</h2><ol>" + out + "</ol></div>\n";
}

/// How sure the first cause is, and what it could be instead.
std::string certainty_of(const Diagnosis& diagnosis) {
  const Cause& first = diagnosis.causes.front();
  const char* unit = micro(diagnosis.baseline.rotary);
  std::string out =
      "<p>" +
      (first.counts.empty() ? text("%.0f %%", 100.0 * std::min(first.confidence, 0.99))
                            : std::string("Counted in the recording")) +
      ".";
  if (std::isfinite(first.gain.before))
    out += text(
        " On data that no fit has used, the model with this cause leaves %.3g %s RMS of the "
        "error; without it %.3g.",
        1e6 * first.gain.after, unit, 1e6 * first.gain.before);
  out += "</p>";
  std::string others;
  for (const std::string& rival : first.ambiguous_with)
    others += (others.empty() ? "" : ", or ") + escaped(plain_name(rival));
  if (!others.empty()) out += "<p>It could also be " + others + ".</p>";
  others.clear();
  for (const Cause& cause : diagnosis.suspected)
    others += (others.empty() ? "" : ", ") + escaped(plain_name(diagnosis, cause));
  if (!others.empty()) out += "<p>Suspected as well: " + others + ".</p>";
  return "<div><h2>How sure</h2>" + out + "</div>\n";
}

/// How to become surer.
std::string next_step_of(const Diagnosis& diagnosis) {
  std::string out;
  if (diagnosis.suggested_test) {
    out = "<p>Record the suggested test";
    if (diagnosis.suggested_test->motion)
      out += text(
          " of %.0f s: <code>servotwin diagnose</code> with <code>--suggested-test</code> "
          "writes it as G-code",
          diagnosis.suggested_test->motion->duration_s());
    out += ". It is described below.</p>";
  }
  if (!diagnosis.not_observable.empty())
    out += text(
        "<p>Of the known causes, this recording cannot show %zu; below is what would show "
        "them.</p>",
        diagnosis.not_observable.size());
  return out.empty() ? out : "<div><h2>If in doubt</h2>" + out + "</div>\n";
}

/// What a maintenance engineer has to know: verdict, what to do, how sure, one picture.
std::string first_screen(const Diagnosis& diagnosis, const std::vector<Segment>& segments,
                         const std::optional<TorqueDiagnosis>& torque) {
  std::string out = "<h1>Axis " + escaped(diagnosis.baseline.axis) + "</h1>\n";
  for (const std::string& sentences : in_short(diagnosis, torque))
    out += "<p class='verdict'>" + escaped(sentences) + "</p>\n";
  out += "<div class='facts'>" + checks_of(diagnosis);
  if (!diagnosis.causes.empty()) out += certainty_of(diagnosis);
  out += next_step_of(diagnosis) + "</div>\n";
  std::string figure;
  if (!diagnosis.causes.empty()) figure = figure_of(diagnosis, diagnosis.causes.front(), segments);
  return out + (figure.empty() ? error_figure(diagnosis, segments) : figure);
}

/// The residual of the extended model: by regime of the commanded motion, by variable and by
/// frequency.
std::string left_of(const Diagnosis& diagnosis, const std::vector<Segment>& segments) {
  const bool rotary = diagnosis.baseline.rotary;
  const char* unit = micro(rotary);
  std::string out =
      "<table><tr><th>while the axis</th><th>RMS</th>"
      "<th>MAX</th>"
      "<th>share of the squared error</th><th>share of the time</th></tr>\n";
  for (const RegimeShare& share : diagnosis.regimes) {
    if (share.samples == 0) continue;
    constexpr std::array kDoes{"is at standstill", "moves at constant speed", "accelerates",
                               "reverses", "has its motor at the torque limit"};
    out += std::string("<tr><td>") + kDoes[static_cast<std::size_t>(share.regime)] + "</td>" +
           text("<td>%.3g %s</td><td>%.3g %s</td><td>%.0f %%</td><td>%.0f %%</td></tr>\n",
                1e6 * share.rms, unit, 1e6 * share.max, unit, 100.0 * share.share,
                100.0 * share.time_share);
  }
  const RegressorShares before = by_regressor(residual_stretches(
      diagnosis.baseline.model, held_out(segments, diagnosis.baseline.training_to_s + 1e-9)));
  out +=
      "</table>\n<p>Residual explained by each variable alone:</p>\n<table><tr><th>variable"
      "</th><th>share of the residual variance</th><th>share reached by chance</th><th></th>"
      "<th>share in the baseline model</th></tr>\n";
  for (const RegressorShare& share : diagnosis.regressors) {
    const RegressorShare& then = before[static_cast<std::size_t>(share.regressor)];
    std::string name = spaced(name_of(share.regressor));
    if (share.regressor == Regressor::kPositionInPeriod)
      name = text("position within %.4g %s", 1e3 * share.period, milli(rotary));
    out += "<tr><td>" + name +
           text("</td><td>%.2g %%</td><td>%.2g %%</td><td>", 100.0 * share.share,
                100.0 * share.chance) +
           (share.significant ? "<b>significant</b>" : "not significant") + "</td><td>" +
           text("%.2g %%", 100.0 * then.share) + (then.significant ? ", significant" : "") +
           (share.regressor == Regressor::kPositionInPeriod && then.significant
                ? text(", %.4g %s", 1e3 * then.period, milli(rotary))
                : "") +
           "</td></tr>\n";
  }
  out += "</table>\n<p>";
  for (const SpectrumPeak& peak : diagnosis.peaks)
    out +=
        text("%s%.1f Hz at %.2g %s", &peak == &diagnosis.peaks.front() ? "Spectral lines: " : ", ",
             peak.frequency_hz, 1e6 * peak.amplitude, unit);
  out += diagnosis.peaks.empty() ? "The residual has no significant spectral line.</p>" : ".</p>";
  if (const RmsEstimate& floor = diagnosis.baseline.noise_floor; std::isfinite(floor.rms)) {
    out += text(
        "<p>The noise floor of the recording, the lowest error that any model can reach, is "
        "%.2g %s RMS",
        1e6 * floor.rms, unit);
    if (std::isfinite(floor.low) && std::isfinite(floor.high))
      out += text(" (%.2g to %.2g)", 1e6 * floor.low, 1e6 * floor.high);
    out += ".</p>";
  }
  return folded("What the model still leaves of the error", out);
}

std::string test_section(const Diagnosis& diagnosis) {
  if (!diagnosis.suggested_test) return {};
  std::string out = "<p>" + escaped(diagnosis.suggested_test->words) + "</p>\n";
  if (const auto& motion = diagnosis.suggested_test->motion; motion) {
    constexpr double kMotionPlotPoints = 2000.0;
    const double h = motion->duration_s() / kMotionPlotPoints, scale = 1e3;
    const Eigen::ArrayXd path = motion->command(h);
    PlotSeries series{"", {}, {}, true, ""};
    for (Eigen::Index k = 0; k < path.size(); ++k) {
      series.x.push_back(h * static_cast<double>(k));
      series.y.push_back(scale * path(k));
    }
    out += "<figure>" +
           plot_svg({{"test motion",
                      "time [s]",
                      diagnosis.baseline.rotary ? "position [mrad]" : "position [mm]",
                      false,
                      {series}}}) +
           "<figcaption><code>servotwin diagnose --suggested-test</code> writes this motion as a "
           "path and as G-code.</figcaption></figure>\n";
  }
  return folded("Suggested test", out);
}

std::string suspected_section(const Diagnosis& diagnosis) {
  if (diagnosis.suspected.empty()) return {};
  std::string out =
      "<p>Their confidence is too low to name them, their gain on held-out data may be zero, or a "
      "parameter is at the limit beyond which it would be something else. They are kept in the "
      "extended model because it predicts better with them.</p>\n<table>";
  for (const Cause& cause : diagnosis.suspected)
    out += row(escaped(plain_name(diagnosis, cause)).c_str(),
               text("confidence %.0f %%: ", 100.0 * cause.confidence) +
                   escaped(cause_text(diagnosis, cause)));
  return folded("Suspected causes", out + "</table>\n");
}

std::string not_observable_section(const Diagnosis& diagnosis) {
  if (diagnosis.not_observable.empty()) return {};
  std::string out = "<p>This recording can neither confirm nor exclude these causes.</p>\n<table>";
  for (const NotObservable& one : diagnosis.not_observable)
    out += row(escaped(plain_name(one.id)).c_str(), escaped(one.why));
  return folded("Not observable here", out + "</table>\n");
}

std::string method_section(const Diagnosis& diagnosis) {
  std::string out =
      "<p>Each candidate was fitted together with the position loop on the first part of the "
      "recording (training data). It was kept only if it significantly lowered the prediction "
      "error of blocks that it was not fitted to. All errors above are those of a free simulation "
      "of the held-out rest, which the search did not use. A " +
      std::string(
          diagnosis.baseline.rotary
              ? "torque per moment of inertia in N m per kg m^2 is an acceleration in rad/s^2"
              : "force per moved mass in N/kg is an acceleration in m/s^2") +
      "; it is reconstructed from the tracking error through the model of the "
      "loop.</p><table><tr><th>cause</th><th>statistic</th><th>p</th></tr>";
  for (const Cause& cause : diagnosis.causes) {
    if (!cause.counts.empty()) continue;
    out += "<tr><td>" + escaped(cause.id) + text("</td><td>%.2f</td><td>", cause.statistic) +
           (std::isfinite(cause.p) ? text("%.2g", cause.p) : "") + "</td></tr>";
  }
  out += "</table><p>Steps of the search, in order:</p><pre>";
  for (const std::string& step : diagnosis.steps) out += escaped(step) + "\n";
  return folded("Method", out + "</pre>\n");
}

}  // namespace

std::string report_html(const Diagnosis& diagnosis, const std::vector<Segment>& segments,
                        const std::string& source, const std::optional<TorqueDiagnosis>& torque,
                        const std::optional<EncoderDifference>& encoders) {
  std::string out =
      "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'><meta name='viewport' "
      "content='width=device-width'>\n<title>Axis " +
      escaped(diagnosis.baseline.axis) + "</title>\n<style>" + kStyle + "</style></head><body>\n";
  out += first_screen(diagnosis, segments, torque) + "<p>From " + escaped(source);
  if (!segments.empty())
    out +=
        text(", %.4g to %.4g s; errors are evaluated on the held-out data after %.4g s",
             segments.front().start_s, segments.back().end_s(), diagnosis.baseline.training_to_s);
  out += ".</p>\n";
  if (encoders)
    out += "<p>Following error " + errors_text(encoders->errors, encoders->rotary) + ". " +
           escaped(plain_text(*encoders)) + "</p>\n";
  for (std::size_t i = 0; i < diagnosis.causes.size(); ++i)
    out += section_of(diagnosis, i, segments);
  if (!diagnosis.causes.empty() &&
      !figure_of(diagnosis, diagnosis.causes.front(), segments).empty())
    out += folded("The error over a few seconds", error_figure(diagnosis, segments));
  return out + test_section(diagnosis) + suspected_section(diagnosis) +
         not_observable_section(diagnosis) + (torque ? torque_section(*torque) : "") +
         frequency_section(diagnosis, segments) + left_of(diagnosis, segments) +
         method_section(diagnosis) + "</body></html>\n";
}

}  // namespace servotwin
