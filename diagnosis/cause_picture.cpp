#include "diagnosis/cause_picture.h"

#include <algorithm>
#include <cmath>

#include "diagnosis/cause_samples.h"
#include "diagnosis/regressor.h"
#include "diagnosis/spectrum.h"
#include "diagnosis/text.h"

namespace servotwin {

namespace {

constexpr double kNaN = kAbsent;
constexpr double kOf95 = 1.96;

bool is(const std::string& id, std::initializer_list<const char*> ids) {
  return std::any_of(ids.begin(), ids.end(), [&](const char* one) { return id == one; });
}

Eigen::ArrayXd array(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::ArrayXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

/// With the sign of the motion: of the moment, or of the way since the axis turned round.
enum class Turned { kNo, kMoving, kSinceTurn };

/// Means of the three over x.
struct Abscissa {
  std::string title, x_label, y_label;
  std::vector<double> x;  // as drawn
  double scale = 1.0;     // of y as drawn
  Turned turned = Turned::kNo;
  int bins = 24;
  std::vector<double> marks = {};
};

PlotPanel panel_over(const CauseSamples& drawn, const Abscissa& over) {
  constexpr double kStanding = 0.005;
  const auto series = [&](const std::vector<double>& values, const char* name, bool line,
                          const char* colour, bool dashed) {
    std::vector<double> y(values.size());
    for (std::size_t i = 0; i < values.size(); ++i) {
      const bool stands = std::abs(drawn.velocity[i]) < kStanding * drawn.fastest;
      const double sign = over.turned == Turned::kNo          ? 1.0
                          : over.turned == Turned::kSinceTurn ? drawn.direction[i]
                          : stands                            ? kNaN
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

/// Values where they belong to |x| < limit, else nothing.
std::vector<double> within(const std::vector<double>& x, double low, double high, double scale) {
  std::vector<double> out(x.size(), kNaN);
  for (std::size_t i = 0; i < x.size(); ++i) {
    if (x[i] >= low && x[i] <= high) out[i] = scale * x[i];
  }
  return out;
}

/// What the simulation is wrong by, without and with the cause, over time.
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
  return {"error of the simulation",
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
    // Peaks of bins of equal width on the logarithmic axis, so that no line is lost.
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
  return {"error of the simulation by frequency",
          "frequency [Hz]",
          "amplitude " + unit,
          true,
          {amplitude(drawn.stretch_without, "without it", "#d9542b"),
           amplitude(drawn.stretch_with, "with it", "#2f9e58")},
          marks};
}

/// The three as they are over a short time.
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
  return {"the largest of them",
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
  const std::string length = rotary ? "mrad" : "mm", micro = rotary ? "[urad]" : "[um]",
                    force = rotary ? "per moved inertia [N m / kg m^2]" : "per moved mass [N/kg]";
  const std::string speed = "speed [" + length + "/s]",
                    acceleration = std::string(rotary ? "[rad/s^2]" : "[m/s^2]");
  const auto shape = [&](std::string_view name) {
    std::size_t i = 0;
    for (const Parameter& p : shapes_of(effect.kind)) {
      if (p.name == name) return effect.shape[i];
      ++i;
    }
    return kNaN;
  };
  double scale = 20e-6;  // of the way in which friction turns over
  for (const char* name : {"breakaway_displacement", "deflection", "width", "length"}) {
    if (std::isfinite(shape(name))) scale = shape(name);
  }
  const CauseSamples drawn = samples_of(diagnosis, cause, segments, scale);
  if (drawn.time.size() < 100) return {};
  const std::string& id = cause.id;
  const std::string friction = is_friction(effect.kind) ? "friction " + force : "force " + force;
  const std::string turned = "friction against the motion " + force;
  std::vector<PlotPanel> panels;
  std::string caption;
  const double all = 1e300;

  if (is(id, {"stribeck", "asymmetric_friction", "gravity_offset"})) {
    panels.push_back(panel_over(
        drawn, {"at all speeds", speed, friction, within(drawn.velocity, -all, all, 1e3)}));
    const double slow = shape("stribeck_velocity");
    if (std::isfinite(slow) && 4.0 * slow < 0.8 * drawn.fastest)
      panels.push_back(panel_over(
          drawn, {"slow", speed, friction, within(drawn.velocity, -4.0 * slow, 4.0 * slow, 1e3)}));
    caption =
        "Friction over speed; what grows with speed alike in both directions is in the loop and "
        "not drawn. Left of zero the axis moves backwards.";
  } else if (is(id, {"presliding", "backlash", "dwell_stiction"})) {
    const bool reading = identity_of(effect.kind).acts == Acts::kReading;
    Abscissa over{"after a reversal",
                  rotary ? "way since the reversal [urad]" : "way since the reversal [um]",
                  reading ? "error of the reading with the motion " + micro : turned,
                  within(drawn.travel, 0.0, 5.0 * scale, 1e6)};
    over.turned = Turned::kSinceTurn;
    over.scale = reading ? 1e6 : 1.0;
    panels.push_back(panel_over(drawn, over));
    if (id == "dwell_stiction")
      panels.push_back(
          panel_over(drawn, {"after a rest", "time since the rest [s]", turned,
                             within(drawn.since_rest, 0.0, 0.5, 1.0), 1.0, Turned::kMoving}));
    caption = id == "backlash"
                  ? "A gap shows as a step right after the axis has turned round."
                  : "After the axis has turned round its friction changes over to the other side "
                    "within this way.";
  } else if (id == "position_dependent_friction") {
    panels.push_back(
        panel_over(drawn, {"along the axis", "position [" + length + "]", turned,
                           within(drawn.position, -all, all, 1e3), 1.0, Turned::kMoving}));
    caption = "Friction where the axis is, both directions together.";
  } else if (is(id, {"cogging", "encoder_error", "lead_error"})) {
    const double period = shape("period");
    std::vector<double> place(drawn.position.size(), kNaN);
    for (std::size_t i = 0; i < place.size(); ++i) {
      if (std::abs(drawn.velocity[i]) > 0.005 * drawn.fastest)
        place[i] = 1e3 * (drawn.position[i] - period * std::floor(drawn.position[i] / period));
    }
    const bool reading = identity_of(effect.kind).acts == Acts::kReading;
    const std::string y = reading ? "error of the reading " + micro : "force " + force;
    const auto [low, high] = std::minmax_element(drawn.position.begin(), drawn.position.end());
    // A period on some points, or it would be another.
    const int bins = std::clamp(static_cast<int>(8.0 * (*high - *low) / period), 24, 240);
    panels.push_back(panel_over(
        drawn, {text("within a period of %.5g ", 1e3 * period) + length,
                "position less whole periods [" + length + "]", y, place, reading ? 1e6 : 1.0}));
    if (reading)
      panels.push_back(
          panel_over(drawn, {"along the axis", "position [" + length + "]", y,
                             within(drawn.position, -all, all, 1e3), 1e6, Turned::kNo, bins}));
    caption = "All periods of the recording laid upon each other.";
  } else if (is(id, {"added_friction", "viscous_drift"})) {
    Abscissa over{"friction over time", "time in the recording [s]", turned, drawn.time, 1.0,
                  Turned::kMoving};
    if (std::isfinite(shape("time_s"))) over.marks = {shape("time_s")};
    panels.push_back(panel_over(drawn, over));
    panels.push_back(error_over_time(drawn, micro, over.marks));
    caption = "The friction of the whole recording in its order of time.";
  } else if (is(id, {"inertia_change", "torque_saturation", "cross_coupling"})) {
    const bool other = id == "cross_coupling";
    std::vector<double> x = within(other ? drawn.neighbour : drawn.acceleration, -all, all, 1.0);
    std::vector<double> marks;
    if (const double since = shape("time_s"); std::isfinite(since)) {
      marks = {since};
      for (std::size_t i = 0; i < x.size(); ++i) {
        if (drawn.time[i] < since) x[i] = kNaN;
      }
    }
    panels.push_back(panel_over(
        drawn, {marks.empty() ? "over acceleration" : "over acceleration, after it",
                (other ? "acceleration of the other axis " : "acceleration ") + acceleration,
                "force " + force, x}));
    panels.push_back(error_over_time(drawn, micro, marks));
    caption = "What the axis needs beyond the simulation, over the commanded acceleration.";
  } else if (is(id, {"compliance", "periodic_disturbance", "cutting_force"})) {
    std::vector<double> marks;
    for (const char* name : {"frequency_hz", "tooth_frequency_hz"}) {
      if (std::isfinite(shape(name))) marks.push_back(shape(name));
    }
    panels.push_back(error_over_frequency(drawn, micro, marks));
    panels.push_back(error_over_time(drawn, micro, {}));
    caption =
        "What the simulation is wrong by, as vibration; the dotted line is the frequency "
        "that was found.";
  } else if (id == "time_delay") {
    panels.push_back(
        panel_over(drawn, {"tracking error over speed", speed, "tracking error " + micro,
                           within(drawn.velocity, -all, all, 1e3), 1e6}));
    caption = "A record that lags makes a tracking error in proportion to the speed.";
  } else if (id == "impulse_disturbance") {
    std::vector<double> marks;
    double largest = 0.0, at = kNaN;
    for (std::size_t i = 0; i < 4; ++i) {
      marks.push_back(effect.shape[i]);
      if (std::abs(effect.coefficient[i]) > largest)
        largest = std::abs(effect.coefficient[i]), at = effect.shape[i];
    }
    panels.push_back(error_over_time(drawn, micro, marks));
    if (std::isfinite(at)) panels.push_back(moment(drawn, at - 0.1, at + 0.15, "force " + force));
    caption = "The dotted lines are the moments at which something pushed.";
  } else {
    std::vector<double> marks;
    if (std::isfinite(shape("time_s"))) marks = {shape("time_s")};
    panels.push_back(error_over_time(drawn, micro, marks));
    caption = "What the simulation is wrong by over the recording.";
    if (id == "thermal_growth")
      panels.push_back(panel_over(drawn, {"error of the reading", "time in the recording [s]",
                                          "error of the reading " + micro, drawn.time, 1e6}));
  }
  std::erase_if(panels, [](const PlotPanel& panel) {
    return std::all_of(panel.series.begin(), panel.series.end(),
                       [](const PlotSeries& s) { return s.x.empty(); });
  });
  return {panels, caption};
}

}  // namespace servotwin
