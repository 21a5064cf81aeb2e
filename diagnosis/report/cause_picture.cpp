#include "diagnosis/report/cause_picture.h"

#include <algorithm>
#include <cmath>

#include "diagnosis/report/cause_samples.h"
#include "diagnosis/statistics/regressor.h"
#include "diagnosis/statistics/spectrum.h"
#include "diagnosis/statistics/text.h"
#include "diagnosis/statistics/thresholds.h"
#include "twin/sample.h"
#include "twin/shown_units.h"

namespace servotwin {

namespace {

bool is(const std::string& id, std::initializer_list<const char*> ids) {
  return std::any_of(ids.begin(), ids.end(), [&](const char* one) { return id == one; });
}

Eigen::ArrayXd array(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::ArrayXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

/// Whether values are multiplied by the direction of motion: not at all, by the sign of the present
/// velocity (nothing at standstill), or by the direction since the last reversal.
enum class Turned { kNo, kMoving, kSinceTurn };

/// What the measured and the two simulated series are plotted over, and how.
struct Abscissa {
  std::string title, x_label, y_label;
  std::vector<double> x;  // in the plotted unit
  double scale = 1.0;     // from SI to the plotted unit of y
  Turned turned = Turned::kNo;
  int bins = 24;
  std::vector<double> marks = {};
};

PlotPanel panel_over(const CauseSamples& drawn, const Abscissa& over) {
  constexpr double kMaxRestSpeedShare = 0.005;  // share of the peak speed: the axis is at rest
  const auto series = [&](const std::vector<double>& values, const char* name, bool line,
                          const char* colour, bool dashed) {
    std::vector<double> y(values.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
      const bool stands = std::abs(drawn.velocity[i]) < kMaxRestSpeedShare * drawn.fastest;
      const double sign = over.turned == Turned::kNo          ? 1.0
                          : over.turned == Turned::kSinceTurn ? drawn.direction[i]
                          : stands                            ? kAbsent
                                   : std::copysign(1.0, drawn.velocity[i]);
      y[i] = over.scale * sign * values[i];
    }
    PlotSeries out{name, {}, {}, line, colour, {}, dashed};
    for (const Bin& bin : bins_of(array(over.x), array(y), over.bins)) {
      out.x.push_back(bin.x);
      out.y.push_back(bin.mean);
      if (!line) out.error.push_back(kOf95 * bin.deviation);
    }
    return out;
  };
  return {over.title,
          over.x_label,
          over.y_label,
          false,
          {series(drawn.without, "simulated without it", true, "#d9542b", true),
           series(drawn.with, "simulated with it", true, "#2f9e58", false),
           series(drawn.measured, "measured", false, "#3b7dd8", false)},
          over.marks};
}

/// The values in low..high, times `scale`; NaN for the others.
std::vector<double> within(const std::vector<double>& x, double low, double high, double scale) {
  std::vector<double> out(x.size(), kAbsent);
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (x[i] >= low && x[i] <= high) out[i] = scale * x[i];
  }
  return out;
}

/// RMS of the simulation error without and with the cause, over time.
PlotPanel error_over_time(const CauseSamples& drawn, const std::string& unit,
                          const std::vector<double>& marks) {
  const auto rms = [&](const std::vector<double>& left, const char* name, const char* colour) {
    PlotSeries out{name, {}, {}, true, colour};
    for (const Bin& bin : bins_of(array(drawn.time), 1e12 * array(left).square(), 80)) {
      out.x.push_back(bin.x);
      out.y.push_back(std::sqrt(bin.mean));
    }
    return out;
  };
  return {"simulation error",
          "time in the recording [s]",
          unit + " RMS",
          false,
          {rms(drawn.left_without, "without it", "#d9542b"),
           rms(drawn.left_with, "with it", "#2f9e58")},
          marks};
}

PlotPanel error_over_frequency(const CauseSamples& drawn, const std::string& unit,
                               const std::vector<double>& marks) {
  const auto amplitude = [&](const std::vector<ResidualStretch>& left, const char* name,
                             const char* colour) {
    const Spectrum spectrum = spectrum_of(left);
    PlotSeries out{name, {}, {}, true, colour};
    // The largest amplitude in each bin of equal width on the logarithmic axis: no line is lost.
    constexpr double kFrom_hz = 1.0, kWidth = 1.012;
    double low = kFrom_hz;
    std::size_t i = 0;
    while (i < spectrum.amplitude.size()) {
      const double high = std::max(low * kWidth, low + spectrum.step_hz);
      double peak = -1.0;
      for (; i < spectrum.amplitude.size() && spectrum.step_hz * static_cast<double>(i) < high;
           ++i) {
        if (spectrum.step_hz * static_cast<double>(i) >= low)
          peak = std::max(peak, spectrum.amplitude[i]);
      }
      if (peak >= 0.0) out.x.push_back(std::sqrt(low * high)), out.y.push_back(1e6 * peak);
      low = high;
    }
    return out;
  };
  return {"spectrum of the simulation error",
          "frequency [Hz]",
          "amplitude " + unit,
          true,
          {amplitude(drawn.stretch_without, "without it", "#d9542b"),
           amplitude(drawn.stretch_with, "with it", "#2f9e58")},
          marks};
}

/// The measured and the two simulated series sample by sample over a short time.
PlotPanel moment(const CauseSamples& drawn, double from, double to, const std::string& y_label) {
  const auto series = [&](const std::vector<double>& values, const char* name, const char* colour,
                          bool dashed) {
    PlotSeries out{name, {}, {}, true, colour, {}, dashed};
    for (std::size_t i = 0; i < values.size(); ++i) {
      if (drawn.time[i] < from || drawn.time[i] > to) continue;
      out.x.push_back(drawn.time[i]);
      out.y.push_back(values[i]);
    }
    return out;
  };
  return {"the largest impulse",
          "time in the recording [s]",
          y_label,
          false,
          {series(drawn.measured, "measured", "#3b7dd8", false),
           series(drawn.without, "simulated without it", "#d9542b", true),
           series(drawn.with, "simulated with it", "#2f9e58", false)}};
}

}  // namespace

CausePicture picture_of(const Diagnosis& diagnosis, const Cause& cause,
                        const std::vector<Segment>& segments) {
  const Model& model = diagnosis.extended.model;
  if (!cause.without || cause.place >= model.effects.size()) return {};
  const Effect& effect = model.effects[cause.place];
  const bool rotary = diagnosis.baseline.rotary;
  const std::string length = milli(rotary), error_unit = std::string("[") + micro(rotary) + "]",
                    force = rotary ? "per moved inertia [N m / kg m^2]" : "per moved mass [N/kg]";
  const std::string speed = "speed [" + length + "/s]",
                    acceleration = std::string(rotary ? "[rad/s^2]" : "[m/s^2]");
  const auto shape = [&](std::string_view name) {
    std::size_t i = 0;
    for (const Parameter& p : shapes_of(effect.kind)) {
      if (p.name == name) return effect.shape[i];
      ++i;
    }
    return kAbsent;
  };
  double scale = 20e-6;  // travel [m | rad] over which friction reverses after a reversal
  for (const char* name : {"breakaway_displacement", "deflection", "width", "length"}) {
    if (std::isfinite(shape(name))) scale = shape(name);
  }
  const CauseSamples drawn = samples_of(diagnosis, cause, segments, scale);
  if (drawn.time.size() < 100) return {};
  const std::string& id = cause.id;
  const std::string friction = is_friction(effect.kind) ? "friction " + force : "force " + force;
  const std::string turned = "friction opposing the motion " + force;
  std::vector<PlotPanel> panels;
  std::string caption;
  const double all = 1e300;

  if (is(id, {"stribeck", "asymmetric_friction", "gravity_offset"})) {
    panels.push_back(
        panel_over(drawn, {"all speeds", speed, friction, within(drawn.velocity, -all, all, 1e3)}));
    const double slow = shape("stribeck_velocity");
    if (std::isfinite(slow) && 4.0 * slow < 0.8 * drawn.fastest)
      panels.push_back(panel_over(drawn, {"low speeds", speed, friction,
                                          within(drawn.velocity, -4.0 * slow, 4.0 * slow, 1e3)}));
    caption =
        "Friction over speed. Viscous friction that is the same in both directions is part of the "
        "loop model and not drawn. Negative speeds are backward motion.";
  } else if (is(id, {"presliding", "backlash", "dwell_stiction"})) {
    const bool reading = identity_of(effect.kind).acts == Acts::kReading;
    Abscissa over{
        "after a reversal", "travel since reversal " + error_unit,
        reading ? "encoder reading error in the direction of motion " + error_unit : turned,
        within(drawn.travel, 0.0, 5.0 * scale, 1e6)};
    over.turned = Turned::kSinceTurn;
    over.scale = reading ? 1e6 : 1.0;
    panels.push_back(panel_over(drawn, over));
    if (id == "dwell_stiction")
      panels.push_back(
          panel_over(drawn, {"after a rest", "time since the rest [s]", turned,
                             within(drawn.since_rest, 0.0, 0.5, 1.0), 1.0, Turned::kMoving}));
    caption = id == "backlash"
                  ? "A gap shows as a step directly after a reversal of the axis."
                  : "After a reversal of the axis its friction changes to the opposite sign over "
                    "this travel.";
  } else if (id == "position_dependent_friction") {
    panels.push_back(
        panel_over(drawn, {"along the axis", "position [" + length + "]", turned,
                           within(drawn.position, -all, all, 1e3), 1.0, Turned::kMoving}));
    caption = "Friction over the position of the axis, both directions together.";
  } else if (is(id, {"cogging", "encoder_error", "lead_error"})) {
    const double period = shape("period");
    std::vector<double> place(drawn.position.size(), kAbsent);
    for (std::size_t i = 0; i < place.size(); ++i) {
      if (std::abs(drawn.velocity[i]) > 0.005 * drawn.fastest)
        place[i] = 1e3 * (drawn.position[i] - period * std::floor(drawn.position[i] / period));
    }
    const bool reading = identity_of(effect.kind).acts == Acts::kReading;
    const std::string y = reading ? "encoder reading error " + error_unit : "force " + force;
    const auto [low, high] = std::minmax_element(drawn.position.begin(), drawn.position.end());
    // About 8 bins for each period; fewer would show a false, longer period (aliasing).
    const int bins = std::clamp(static_cast<int>(8.0 * (*high - *low) / period), 24, 240);
    panels.push_back(panel_over(
        drawn, {text("within a period of %.5g ", 1e3 * period) + length,
                "position modulo the period [" + length + "]", y, place, reading ? 1e6 : 1.0}));
    if (reading)
      panels.push_back(
          panel_over(drawn, {"along the axis", "position [" + length + "]", y,
                             within(drawn.position, -all, all, 1e3), 1e6, Turned::kNo, bins}));
    caption = "All periods of the recording superimposed.";
  } else if (is(id, {"added_friction", "viscous_drift"})) {
    Abscissa over{"friction over time", "time in the recording [s]", turned, drawn.time, 1.0,
                  Turned::kMoving};
    if (std::isfinite(shape("time_s"))) over.marks = {shape("time_s")};
    panels.push_back(panel_over(drawn, over));
    panels.push_back(error_over_time(drawn, error_unit, over.marks));
    caption = "Friction over the time of the recording.";
  } else if (is(id, {"inertia_change", "torque_saturation", "cross_coupling"})) {
    const bool other = id == "cross_coupling";
    std::vector<double> x = within(other ? drawn.neighbour : drawn.acceleration, -all, all, 1.0);
    std::vector<double> marks;
    if (const double since = shape("time_s"); std::isfinite(since)) {
      marks = {since};
      for (std::size_t i = 0; i < x.size(); ++i) {
        if (drawn.time[i] < since) x[i] = kAbsent;
      }
    }
    panels.push_back(panel_over(
        drawn, {marks.empty() ? "over acceleration" : "over acceleration, after the change",
                (other ? "acceleration of the other axis " : "acceleration ") + acceleration,
                "force " + force, x}));
    panels.push_back(error_over_time(drawn, error_unit, marks));
    caption = "Force that the axis needs in addition to the simulated one, over the acceleration.";
  } else if (is(id, {"compliance", "periodic_disturbance", "cutting_force"})) {
    std::vector<double> marks;
    for (const char* name : {"frequency_hz", "tooth_frequency_hz"}) {
      if (std::isfinite(shape(name))) marks.push_back(shape(name));
    }
    panels.push_back(error_over_frequency(drawn, error_unit, marks));
    panels.push_back(error_over_time(drawn, error_unit, {}));
    caption =
        "Amplitude spectrum of the simulation error; the dotted line is the identified frequency.";
  } else if (id == "time_delay") {
    panels.push_back(
        panel_over(drawn, {"tracking error over speed", speed, "tracking error " + error_unit,
                           within(drawn.velocity, -all, all, 1e3), 1e6}));
    caption = "A delayed record makes a tracking error in proportion to the speed.";
  } else if (id == "impulse_disturbance") {
    std::vector<double> marks;
    double largest = 0.0, at = kAbsent;
    for (std::size_t i = 0; i < 4; ++i) {
      marks.push_back(effect.shape[i]);
      if (std::abs(effect.coefficient[i]) > largest)
        largest = std::abs(effect.coefficient[i]), at = effect.shape[i];
    }
    panels.push_back(error_over_time(drawn, error_unit, marks));
    if (std::isfinite(at)) panels.push_back(moment(drawn, at - 0.1, at + 0.15, "force " + force));
    caption = "The dotted lines are the times of the impulses.";
  } else {
    std::vector<double> marks;
    if (std::isfinite(shape("time_s"))) marks = {shape("time_s")};
    panels.push_back(error_over_time(drawn, error_unit, marks));
    caption = "The simulation error over the recording.";
    if (id == "thermal_growth")
      panels.push_back(panel_over(drawn, {"encoder reading error", "time in the recording [s]",
                                          "encoder reading error " + error_unit, drawn.time, 1e6}));
  }
  std::erase_if(panels, [](const PlotPanel& panel) {
    return std::all_of(panel.series.begin(), panel.series.end(),
                       [](const PlotSeries& s) { return s.x.empty(); });
  });
  return {panels, caption};
}

}  // namespace servotwin
