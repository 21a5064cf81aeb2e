#include "cli/recording/prediction_plot.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "twin/shown_units.h"
#include "twin/twin.h"

namespace servotwin::cli {

namespace {

constexpr const char* kResidualColour = "#2f9e58";
constexpr const char* kQuietColour = "#6b7785";  // what is no error
constexpr double kMaxShown = 1e4;                // ticks of more digits have no room

/// Puts the values of a panel into the smallest unit that keeps them below kMaxShown.
void scale(PlotPanel& panel, bool rotary, const std::string& what) {
  double most = 0.0;
  for (const PlotSeries& s : panel.series) {
    for (const double v : s.y) most = std::isfinite(v) ? std::max(most, std::abs(v)) : most;
  }
  struct Unit {
    double size = 1.0;
    const char* name = "";
  };
  const std::array<Unit, 3> units{
      {{kMicro, micro(rotary)}, {kMilli, milli(rotary)}, {1.0, rotary ? "rad" : "m"}}};
  const Unit& unit = *std::find_if(units.begin(), units.end() - 1,
                                   [most](const Unit& u) { return most < kMaxShown * u.size; });
  for (PlotSeries& s : panel.series) {
    for (double& v : s.y) v /= unit.size;
    for (double& v : s.error) v /= unit.size;
  }
  panel.y_label = what + " [" + unit.name + "]";
}

}  // namespace

std::vector<PlotPanel> prediction_panels(const std::string& axis, bool rotary, const Model& model,
                                         const std::vector<Segment>& segments,
                                         const ErrorFigures& figures, const RmsEstimate& floor) {
  PlotSeries measured{"measured (command minus encoder)", {}, {}, true, ""},
      predicted{"predicted from the command alone", {}, {}, true, ""},
      residual{"measured minus predicted: " + micro_text(figures.rms, rotary, 3) + " RMS, " +
                   micro_text(figures.max, rotary, 3) + " MAX",
               {},
               {},
               true,
               kResidualColour},
      command{"", {}, {}, true, kQuietColour};
  predicted.dashed = true;
  for (const Segment& s : segments) {
    const Eigen::ArrayXd error = s.command - s.actual, simulated = simulate(model, s);
    const Eigen::Index judged = std::max(s.lead, starting_state_samples(model, s));
    for (PlotSeries* series : {&measured, &predicted, &residual, &command}) {
      series->x.push_back(s.start_s);
      series->y.push_back(kAbsent);  // a gap between the segments
    }
    for (Eigen::Index k = s.lead; k < s.size(); ++k) {
      const double t = s.start_s + s.sample_time_s * static_cast<double>(k);
      const auto add = [t](PlotSeries& series, double value) {
        series.x.push_back(t);
        series.y.push_back(value);
      };
      add(measured, error(k));
      add(command, s.command(k));
      if (k < judged) continue;
      add(predicted, simulated(k));
      add(residual, error(k) - simulated(k));
    }
  }
  // Over the time of all panels, so that their axes agree.
  PlotSeries zero{"", {}, {0.0, 0.0}, true, kQuietColour};
  zero.x = {segments.front().start_s +
                segments.front().sample_time_s * static_cast<double>(segments.front().lead),
            segments.back().end_s()};
  if (std::isfinite(floor.rms)) {
    zero.name = "noise floor: " + micro_text(floor.rms, rotary, 3) + " RMS";
    zero.error = {floor.rms, floor.rms};
  }
  std::vector<PlotPanel> panels(3);
  panels[0].title = "axis " + axis;
  panels[0].series = {measured, predicted};
  scale(panels[0], rotary, "tracking error");
  panels[1].series = {residual, zero};
  scale(panels[1], rotary, "residual");
  panels[2].series = {command};
  scale(panels[2], rotary, "command");
  panels[2].x_label = "time [s]";
  return panels;
}

}  // namespace servotwin::cli
