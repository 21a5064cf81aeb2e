#include "diagnosis/report.h"

#include <cmath>

#include "diagnosis/diagnosis_file.h"
#include "diagnosis/plot.h"
#include "diagnosis/text.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

constexpr double kShown_s = 4.0;  // of the hold-out, from its middle

/// Nothing where it is not known.
std::string in_micro(double value, const char* unit) {
  return std::isfinite(value) ? text("%.3g %s", 1e6 * value, unit) : "";
}

/// What the two models leave over a few seconds of the hold-out, on one scale.
std::string picture(const Diagnosis& diagnosis, const std::vector<Segment>& segments) {
  const bool rotary = diagnosis.baseline.rotary;
  const std::vector<Segment> holdout =
      cut(segments, diagnosis.baseline.training_to_s + 1e-9, 1e300);
  if (holdout.empty()) return {};
  const Segment& s = holdout.front();
  const Eigen::ArrayXd error = s.command - s.actual;
  const Eigen::ArrayXd before = 1e6 * (error - simulate(diagnosis.baseline.model, s)),
                       after = 1e6 * (error - simulate(diagnosis.extended.model, s));
  const auto count = std::min<Eigen::Index>(
      s.size(), static_cast<Eigen::Index>(std::lround(kShown_s / s.sample_time_s)));
  const Eigen::Index begin = (s.size() - count) / 2;
  PlotSeries measured{"measured", {}, {}, true, ""},
      baseline{"left by the baseline", {}, {}, true, ""},
      extended{"left by the extended model", {}, {}, true, ""};
  for (Eigen::Index k = begin; k < begin + count; ++k) {
    const double t = s.start_s + s.sample_time_s * static_cast<double>(k);
    measured.x.push_back(t);
    measured.y.push_back(1e6 * error(k));
    baseline.x.push_back(t);
    baseline.y.push_back(before(k));
    extended.x.push_back(t);
    extended.y.push_back(after(k));
  }
  const std::string unit = rotary ? "[urad]" : "[um]";
  return plot_svg({{"tracking error", "time [s]", unit, false, {measured}},
                   {"measured minus simulated", "time [s]", unit, false, {baseline, extended}}});
}

}  // namespace

std::string report_html(const Diagnosis& diagnosis, const std::vector<Segment>& segments,
                        const std::string& source, const std::string& more) {
  const char* unit = diagnosis.baseline.rotary ? "urad" : "um";
  std::string out =
      "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'><meta name='viewport' "
      "content='width=device-width'>\n<title>Axis " +
      escaped(diagnosis.baseline.axis) +
      "</title>\n<style>body{font:16px sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem;"
      "color-scheme:light dark}table{border-collapse:collapse}td,th{padding:.3rem .8rem;text-align:"
      "left;border-bottom:1px solid #8884}svg{max-width:100%;height:auto}.verdict{font-size:1.3rem}"
      "</style></head><body>\n";
  out += "<h1>Axis " + escaped(diagnosis.baseline.axis) + "</h1>\n<p class='verdict'>" +
         escaped(verdict_text(diagnosis)) + ".</p>\n<p>" + escaped(source) + "</p>\n" +
         picture(diagnosis, segments);
  if (!diagnosis.causes.empty()) {
    out +=
        "<h2>What the simulation got wrong</h2>\n<table><tr><th>cause</th><th>how large</th>"
        "<th>error without it</th><th>with it</th><th>gain, 95 %</th><th>sure</th>"
        "<th>what to check</th></tr>\n";
    for (const Cause& cause : diagnosis.causes) {
      out += "<tr><td>" + escaped(cause.id) + "</td><td>" + escaped(cause_text(diagnosis, cause)) +
             "</td><td>" + in_micro(cause.gain.before, unit) + "</td><td>" +
             in_micro(cause.gain.after, unit) + "</td><td>" +
             (std::isfinite(cause.gain.low)
                  ? text("%.2g to %.2g %s", 1e6 * cause.gain.low, 1e6 * cause.gain.high, unit)
                  : "") +
             "</td><td>" +
             (cause.place == kNoEffect ? "counted" : text("%.0f %%", 100.0 * cause.confidence));
      for (const std::string& rival : cause.ambiguous_with) out += "<br>or " + escaped(rival);
      out += "</td><td>" + escaped(advice_for(cause.id)) + "</td></tr>\n";
    }
    out += "</table>\n";
  }
  out += more;
  out +=
      "<h2>What is left, by what the command does</h2>\n<table><tr><th></th><th>RMS</th><th>MAX"
      "</th><th>share of the squared error</th><th>share of the time</th></tr>\n";
  for (const RegimeShare& share : diagnosis.regimes) {
    out += "<tr><td>" + std::string(name_of(share.regime)) + "</td>" +
           text("<td>%.3g %s</td><td>%.3g %s</td><td>%.0f %%</td><td>%.0f %%</td></tr>\n",
                1e6 * share.rms, unit, 1e6 * share.max, unit, 100.0 * share.share,
                100.0 * share.time_share);
  }
  out +=
      "</table>\n<details><summary>How this was found</summary><p>Candidates were fitted with the "
      "loop on the first part of the recording and had to predict blocks of it that they had not "
      "seen better than without them, by more than chance. All errors above are in free "
      "simulation on the rest, which decided nothing.</p><table><tr><th>cause</th><th>statistic"
      "</th><th>p</th></tr>";
  for (const Cause& cause : diagnosis.causes) {
    if (cause.place == kNoEffect) continue;
    out += "<tr><td>" + escaped(cause.id) +
           text("</td><td>%.2f</td><td>%.2g</td></tr>", cause.statistic, cause.p);
  }
  out += "</table><p>What was tried, in its order:</p><pre>";
  for (const std::string& step : diagnosis.steps) out += escaped(step) + "\n";
  return out + "</pre></details>\n</body></html>\n";
}

}  // namespace servotwin
