#include "diagnosis/cause_picture.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "diagnosis/regressor.h"
#include "diagnosis/spectrum.h"
#include "diagnosis/text.h"
#include "identification/projection.h"
#include "twin/low_pass.h"
#include "twin/twin.h"

namespace servotwin {

namespace {

constexpr double kNaN = kAbsent;
constexpr double kSettle_s = 0.5;      // of every segment: its starting state is not the cause's
constexpr double kBandwidth_hz = 100;  // of forces that are got back from the error
constexpr double kForgets_s = 1.0;     // of the integrator
constexpr double kOf95 = 1.96;

bool is(const std::string& id, std::initializer_list<const char*> ids) {
  return std::any_of(ids.begin(), ids.end(), [&](const char* one) { return id == one; });
}

bool is_friction(std::size_t kind) {
  constexpr std::array kKinds{kind_of<CoulombFriction>(),
                              kind_of<ConstantForce>(),
                              kind_of<Presliding>(),
                              kind_of<SmoothedPresliding>(),
                              kind_of<Gms>(),
                              kind_of<LuGre>(),
                              kind_of<Dahl>(),
                              kind_of<Stribeck>(),
                              kind_of<ModifiedStribeck>(),
                              kind_of<FrictionMap>(),
                              kind_of<AsymmetricFriction>(),
                              kind_of<PreslidingStribeck>(),
                              kind_of<FallingFriction>(),
                              kind_of<PositionDependentFriction>(),
                              kind_of<AddedFriction>(),
                              kind_of<ViscousDrift>(),
                              kind_of<DwellStiction>()};
  return std::find(kKinds.begin(), kKinds.end(), kind) != kKinds.end();
}

/// The samples of all segments, with what is drawn of them; NaN where nothing is to be drawn.
struct Drawn {
  std::vector<double> velocity, acceleration, neighbour, position, time, since_rest;
  std::vector<double> travel, direction;                       // since the axis turned round
  std::vector<double> measured, without, with;                 // force, length or error
  std::vector<double> left_without, left_with;                 // measured less simulated [m | rad]
  std::vector<ResidualStretch> stretch_without, stretch_with;  // the same
  double fastest = 0.0;
};

/// The way since the last turn of more than `least`, and the direction since; NaN before the first.
struct Turns {
  Eigen::ArrayXd travel, direction;
};
Turns turns_of(const Eigen::ArrayXd& x, double least) {
  Turns out{Eigen::ArrayXd::Constant(x.size(), kNaN), Eigen::ArrayXd::Constant(x.size(), kNaN)};
  double direction = 0.0;
  bool turned = false;
  Eigen::Index extreme = 0, turn = 0;
  const auto put = [&](Eigen::Index k) {
    out.travel(k) = std::max(0.0, direction * (x(k) - x(turn)));
    out.direction(k) = direction;
  };
  for (Eigen::Index k = 0; k < x.size(); ++k) {
    const double way = x(k) - x(extreme);
    if (direction == 0.0 ? std::abs(way) > least : direction * way < -least) {
      turned = direction != 0.0;
      direction = way > 0.0 ? 1.0 : -1.0;
      turn = extreme;
      extreme = k;
      // What lies between the turn and here has turned already.
      for (Eigen::Index i = turn; turned && i < k; ++i) put(i);
    } else if (direction * way > 0.0) {
      extreme = k;
    }
    if (turned) put(k);
  }
  return out;
}

/// What an effect does along a motion, per sample.
Eigen::ArrayXd along(const Effect& effect, const Signals& signals, const Spline& command) {
  EffectMemory<double> memory;
  start_memory(effect.kind, effect.shape.data(), memory);
  Eigen::ArrayXd out(signals.size());
  std::array<double, kMaxCoefficients> unit{};
  const std::size_t count = coefficients_of(effect.kind).size();
  for (Eigen::Index k = 0; k < signals.size(); ++k) {
    const Motion m = motion_of(signals, command, identity_of(effect.kind).acts, k);
    unit_forces<double>(effect.kind, effect.shape.data(), memory, m, unit.data());
    out(k) = 0.0;
    for (std::size_t i = 0; i < count; ++i) out(k) += effect.coefficient[i] * unit[i];
  }
  return out;
}

/// The disturbance that would make this difference of tracking errors.
Eigen::ArrayXd force_of(const Loop& loop, const Eigen::ArrayXd& difference, double h) {
  const Eigen::Index n = difference.size();
  const Eigen::ArrayXd e = zero_phase(butterworth(4, std::min(0.3, kBandwidth_hz * h)), difference);
  Eigen::ArrayXd out = Eigen::ArrayXd::Zero(n);
  double integral = 0.0;
  for (Eigen::Index k = 1; k + 1 < n; ++k) {
    const double first = (e(k + 1) - e(k - 1)) / (2.0 * h),
                 second = (e(k + 1) - 2.0 * e(k) + e(k - 1)) / (h * h);
    integral += h * (e(k) - integral / kForgets_s);
    out(k) = second + loop.denominator[0] * first + loop.denominator[1] * e(k) +
             (loop.order == 3 ? loop.denominator[2] * integral : 0.0);
  }
  return out;
}

Drawn drawn_of(const Diagnosis& diagnosis, const Cause& cause, const std::vector<Segment>& segments,
               double scale) {
  Drawn out;
  const Model& with = diagnosis.extended.model;
  const Model& without = *cause.without;
  const Effect& effect = with.effects[cause.place];
  const Acts acts = identity_of(effect.kind).acts;
  Model loop = with;
  std::erase_if(loop.effects,
                [](const Effect& e) { return identity_of(e.kind).acts == Acts::kReading; });
  for (const Segment& s : segments) {
    const double h = s.sample_time_s;
    const auto skip = std::max<Eigen::Index>(s.lead, std::lround(kSettle_s / h));
    if (s.size() < 2 * skip + 100) continue;
    const Eigen::ArrayXd error = s.command - s.actual, by_with = simulate(with, s),
                         by_without = simulate(without, s);
    Signals signals = signals_of(s);
    signals.loop_position = s.command - simulate(loop, s);
    signals.position = signals.loop_position;
    signals.velocity = measured_velocity(signals.position, h, 0);
    const Spline command = Spline::through(signals.command.delayed(with.command_delay_s()), h);

    Eigen::ArrayXd measured, base, one = Eigen::ArrayXd::Zero(s.size());
    if (acts == Acts::kCommandDelay) {
      one = by_with, measured = error, base = by_without;
    } else if (acts == Acts::kReading) {
      one = along(effect, signals, command);
      measured = one - (error - by_with), base = one - (by_without - by_with);
    } else {
      for (const Effect& e : with.effects) {
        if (&e == &effect || (is_friction(effect.kind) && is_friction(e.kind)))
          one += along(e, signals, command);
      }
      measured = one + force_of(with.loop, error - by_with, h);
      base = one + force_of(with.loop, by_without - by_with, h);
    }
    const ResidualStretch stretch{s.command, error - by_with, h, s.start_s};
    out.stretch_with.push_back(stretch);
    out.stretch_without.push_back({s.command, error - by_without, h, s.start_s});
    // Effects live in where the axis is and not in where it was sent.
    const Variables v = variables_of({signals.position, stretch.residual, h, s.start_s});
    const Turns turns = turns_of(signals.position, 0.01 * scale);
    for (Eigen::Index k = skip; k + skip < s.size(); ++k) {
      if (!std::isfinite(v.velocity(k)) || !std::isfinite(v.acceleration(k))) continue;
      out.velocity.push_back(v.velocity(k));
      out.fastest = std::max(out.fastest, std::abs(v.velocity(k)));
      out.acceleration.push_back(v.acceleration(k));
      out.neighbour.push_back(
          signals.neighbour_acceleration.size() > 0 ? signals.neighbour_acceleration(k) : kNaN);
      out.position.push_back(v.position(k));
      out.time.push_back(v.time(k));
      out.travel.push_back(turns.travel(k));
      out.direction.push_back(turns.direction(k));
      out.since_rest.push_back(v.since_rest_s(k));
      out.measured.push_back(measured(k));
      out.without.push_back(base(k));
      out.with.push_back(one(k));
      out.left_without.push_back(error(k) - by_without(k));
      out.left_with.push_back(error(k) - by_with(k));
    }
  }
  return out;
}

Eigen::ArrayXd array(const std::vector<double>& values) {
  return Eigen::Map<const Eigen::ArrayXd>(values.data(), static_cast<Eigen::Index>(values.size()));
}

/// With the sign of the motion: of the moment, or of the way since the axis turned round.
enum class Turned { kNo, kMoving, kSinceTurn };

/// Means of the three over x.
struct Over {
  std::string title, x_label, y_label;
  std::vector<double> x;  // as drawn
  double scale = 1.0;     // of y as drawn
  Turned turned = Turned::kNo;
  int bins = 24;
  std::vector<double> marks = {};
};

PlotPanel panel_over(const Drawn& drawn, const Over& over) {
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
PlotPanel error_over_time(const Drawn& drawn, const std::string& unit,
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

PlotPanel error_over_frequency(const Drawn& drawn, const std::string& unit,
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
PlotPanel moment(const Drawn& drawn, double from, double to, const std::string& y_label) {
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
  const Drawn drawn = drawn_of(diagnosis, cause, segments, scale);
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
    Over over{"after a reversal",
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
    Over over{"friction over time", "time in the recording [s]", turned, drawn.time, 1.0,
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
