// The page of `learn --report`.
#include <algorithm>
#include <cmath>

#include "cli/common/model_text.h"
#include "cli/common/output.h"
#include "cli/recording/correction.h"
#include "diagnosis/report/plot.h"
#include "diagnosis/statistics/text.h"
#include "drivers/common/text.h"
#include "twin/shown_units.h"

namespace servotwin::cli {
namespace {

constexpr const char* kStyle =
    ":root{color-scheme:light dark;--line:#8884}"
    "body{font:16px/1.5 sans-serif;max-width:72rem;margin:2rem auto;padding:0 1rem}"
    "table{border-collapse:collapse}td,th{padding:.3rem .8rem;text-align:right;"
    "border-bottom:1px solid var(--line)}td:first-child,th:first-child{text-align:left}"
    "svg{max-width:100%;height:auto;border-radius:.3rem}"
    ".verdict{font-size:1.25rem;border-left:.3rem solid #3b7dd8;padding:.2rem 1rem}"
    "section{border-top:1px solid var(--line);margin-top:2rem}"
    "figure{margin:1rem 0}figcaption{opacity:.8}";
constexpr const char *kBefore = "#d9542b", *kAfter = "#2f9e58", *kPath = "#8889";
constexpr std::size_t kMaxPointsPerLine = 4000;
constexpr double kDrawnDeviation = 0.12;  // of the largest deviation over the size of the path
constexpr double kPanelAspect = 480.0 / 300.0;  // about, of the plotted area

Eigen::Index stride(Eigen::Index samples) {
  return std::max<Eigen::Index>(1, samples / static_cast<Eigen::Index>(kMaxPointsPerLine));
}

std::string figure(const std::string& svg, const std::string& caption) {
  return "<figure>" + svg + "<figcaption>" + escaped(caption) + "</figcaption></figure>\n";
}

/// 1, 2 or 5 times a power of ten, at most this.
double round_below(double value) {
  const double decade = std::pow(10.0, std::floor(std::log10(value)));
  return (value >= 5.0 * decade ? 5.0 : value >= 2.0 * decade ? 2.0 : 1.0) * decade;
}

/// The path of the first two linear axes, and the path that the axes follow, with `error`
/// magnified.
PlotPanel path_panel(const Correction& correction, const ProgramError& error,
                     const std::string& when, const char* colour) {
  std::vector<const LearnAxis*> plane;
  for (const CorrectedAxis& axis : correction.axes) {
    if (!axis.learning.rotary && plane.size() < 2) plane.push_back(&axis.learning);
  }
  const Eigen::ArrayXd &x = plane[0]->path.command, &y = plane[1]->path.command;
  const double width = x.maxCoeff() - x.minCoeff(), height = y.maxCoeff() - y.minCoeff();
  double furthest = 0.0;
  for (const PathPoint& away : error.away)
    furthest = std::max(furthest, std::hypot(away[0], away[1]));
  const double size = std::max(width, height);
  const double magnified = furthest > 0.0 ? round_below(kDrawnDeviation * size / furthest) : 1.0;

  PlotSeries path{"commanded", {}, {}, true, kPath},
      actual{text("deviation, %.0f times", magnified), {}, {}, true, colour};
  for (Eigen::Index k = 0; k < x.size(); k += stride(x.size())) {
    const auto low = static_cast<Eigen::Index>(error.place(k));
    const Eigen::Index high = std::min(low + 1, x.size() - 1);
    const double part = error.place(k) - static_cast<double>(low);
    const PathPoint& away = error.away[static_cast<std::size_t>(k)];
    path.x.push_back(1e3 * x(k));
    path.y.push_back(1e3 * y(k));
    actual.x.push_back(1e3 * (x(low) + part * (x(high) - x(low)) + magnified * away[0]));
    actual.y.push_back(1e3 * (y(low) + part * (y(high) - y(low)) + magnified * away[1]));
  }
  // Two points that are not drawn give both directions the same scale.
  const double half = 0.5 * 1.25 * std::max(height, width / kPanelAspect);
  const double cx = 0.5 * (x.maxCoeff() + x.minCoeff()), cy = 0.5 * (y.maxCoeff() + y.minCoeff());
  PlotSeries frame{"",
                   {1e3 * (cx - kPanelAspect * half), 1e3 * (cx + kPanelAspect * half)},
                   {1e3 * (cy - half), 1e3 * (cy + half)},
                   false,
                   "none"};
  return {when + text(": up to %.3g um from the path", 1e6 * error.distance.abs().maxCoeff()),
          plane[0]->name + " [mm]",
          plane[1]->name + " [mm]",
          false,
          {frame, path, actual}};
}

PlotPanel error_panel(const LearnAxis& axis, const Eigen::ArrayXd& error, const std::string& when,
                      const char* colour) {
  PlotSeries series{"", {}, {}, true, colour};
  for (Eigen::Index k = 0; k < error.size(); k += stride(error.size())) {
    series.x.push_back(axis.path.start_s + axis.path.sample_time_s * static_cast<double>(k));
    series.y.push_back(1e6 * error(k));
  }
  return {axis.name + ": tracking error " + when,
          "time [s]",
          std::string("error [") + micro(axis.rotary) + "]",
          false,
          {series}};
}

PlotPanel learning_panel(const Correction& correction) {
  PlotPanel panel{"learning curve", "trial", "RMS [um, urad]", false, {}};
  panel.logarithmic_y = true;
  const auto add = [&](const std::string& name, auto rms_of) {
    PlotSeries series{name, {}, {}, true, ""};
    for (std::size_t t = 0; t < correction.learned.trials.size(); ++t) {
      series.x.push_back(static_cast<double>(t));
      series.y.push_back(1e6 * rms_of(correction.learned.trials[t]));
    }
    panel.series.push_back(std::move(series));
  };
  for (std::size_t i = 0; i < correction.axes.size(); ++i)
    add(correction.axes[i].learning.name + " tracking",
        [i](const Trial& trial) { return trial.axis[i].rms; });
  if (correction.learned.before)
    add("contour", [](const Trial& trial) { return trial.contour.rms; });
  panel.marks = {static_cast<double>(correction.learned.best)};
  return panel;
}

PlotPanel contraction_panel(const Correction& correction) {
  const bool trials = !correction.options.feedforward_only;
  PlotPanel panel{trials ? "error remaining after a trial: |Q (1 - L T)|"
                         : "error remaining after the correction: |1 - Q L T|",
                  "frequency [Hz]",
                  "share of the error",
                  true,
                  {}};
  for (const CorrectedAxis& axis : correction.axes) {
    const ContractionCurve& curve = axis.contraction;
    PlotSeries series{axis.learning.name + ", worst model", {}, {}, true, ""};
    series.x.assign(curve.frequency_hz.begin(), curve.frequency_hz.end());
    series.y.assign(curve.worst.begin(), curve.worst.end());
    panel.series.push_back(std::move(series));
  }
  const Eigen::ArrayXd& f = correction.axes.front().contraction.frequency_hz;
  panel.series.push_back({trials ? "must stay below" : "no correction",
                          {f(0), f(f.size() - 1)},
                          {1.0, 1.0},
                          true,
                          "#6b7785",
                          {},
                          true});
  return panel;
}

}  // namespace

std::string report_html(const Correction& correction) {
  const Learned& learned = correction.learned;
  const Trial &first = learned.trials.front(), &best = learned.trials[learned.best];
  std::string out =
      "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'><meta name='viewport' "
      "content='width=device-width'>\n<title>Corrected path</title>\n<style>";
  out += std::string(kStyle) + "</style></head><body>\n<h1>Corrected path of " +
         escaped(correction.source) + "</h1>\n<p class='verdict'>";
  const bool trials = !correction.options.feedforward_only;
  const std::string how = trials
                              ? "after " + counted(learned.best, "virtual trial") + " on the twin."
                              : "on the twin, without a trial.";
  if (learned.best == 0) {
    out += "No correction reduces the error: the path is unchanged.";
  } else if (learned.before) {
    out += text("Contour error %.3g um RMS instead of %.3g, ", 1e6 * best.contour.rms,
                1e6 * first.contour.rms) +
           how;
  } else {
    out += text("Tracking error %.3g %s RMS instead of %.3g, ", 1e6 * best.axis[0].rms,
                micro(correction.axes[0].learning.rotary), 1e6 * first.axis[0].rms) +
           how;
  }
  out +=
      "</p>\n<table><tr><th></th><th>before, RMS</th><th>MAX</th><th>after, RMS</th><th>MAX</th>"
      "<th>expected on the machine, RMS</th><th>limited by</th></tr>\n";
  const auto row = [&](const std::string& name, const ErrorSize& before, const ErrorSize& after,
                       const char* unit, const std::string& expected, const std::string& why) {
    out += "<tr><td>" + escaped(name) + "</td>" +
           text("<td>%.4g %s</td><td>%.4g</td><td>%.4g</td><td>%.4g</td><td>", 1e6 * before.rms,
                unit, 1e6 * before.max, 1e6 * after.rms, 1e6 * after.max) +
           expected + "</td><td>" + escaped(why) + "</td></tr>\n";
  };
  for (std::size_t i = 0; i < correction.axes.size(); ++i) {
    const double expected = expected_rms(correction, i);
    row(correction.axes[i].learning.name + ", tracking", first.axis[i], best.axis[i],
        micro(correction.axes[i].learning.rotary),
        std::isfinite(expected) && correction.options.aim == Aim::kTracking
            ? text("%.3g", 1e6 * expected)
            : "",
        limited_by(correction, i));
  }
  const double across = expected_contour_rms(correction);
  if (learned.before)
    row("contour", first.contour, best.contour, "um",
        std::isfinite(across) ? text("%.3g", 1e6 * across) : "", "");
  if (learned.before && learned.before->turned.size() > 0)
    row("orientation", first.turned, best.turned, "urad", "", "");
  out += "</table>\n";
  if (const std::string shares = shares_text(correction); !shares.empty())
    out += "<p>The contour error before is made of: " + escaped(shares) + ".</p>\n";
  if (learned.before)
    out += "<section><h2>The path</h2>" +
           figure(plot_svg({path_panel(correction, *learned.before, "before", kBefore),
                            path_panel(correction, *learned.after, "after", kAfter)}),
                  "The deviation is drawn perpendicular to the path, magnified as the legend says; "
                  "the two plots have different scales.") +
           "</section>\n";
  out += "<section><h2>The axes</h2>\n";
  for (std::size_t i = 0; i < correction.axes.size(); ++i) {
    const LearnAxis& axis = correction.axes[i].learning;
    PlotPanel correction_panel = error_panel(axis, learned.axes[i].correction, "", "#3b7dd8");
    correction_panel.title = axis.name + ": correction added to the command";
    correction_panel.y_label = std::string("correction [") + micro(axis.rotary) + "]";
    out += figure(
        plot_svg({error_panel(axis, learned.axes[i].error_before, "before", kBefore),
                  error_panel(axis, learned.axes[i].error_after, "after", kAfter),
                  correction_panel}),
        "Command minus position, simulated on the full twin. The plots have different scales.");
  }
  out +=
      "</section>\n<section><h2>How it was learned</h2>\n" +
      figure(plot_svg({learning_panel(correction), contraction_panel(correction)}),
             "Left: error of every virtual trial; the dotted line marks the one that was kept. "
             "Right: the largest share of the error that remains with any model within the "
             "uncertainty, at every frequency. " +
                 std::string(trials ? "Below 1 everywhere, learning converges."
                                    : "Up to 1 everywhere, the correction makes no model worse."));
  for (const CorrectedAxis& axis : correction.axes) {
    out +=
        "<p>" + escaped(axis.learning.name + ": " + bandwidth_text(correction, axis)) + ".</p>\n";
  }
  return out + "</section>\n</body></html>\n";
}

}  // namespace servotwin::cli
