#include "diagnosis/report/cause_words.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "diagnosis/report/diagnosis_file.h"
#include "diagnosis/statistics/text.h"
#include "twin/shown_units.h"

namespace servotwin {

namespace {

using nlohmann::json;

constexpr std::array<std::pair<const char*, const char*>, 24> kNames{{
    {"stribeck", "friction that differs between creeping and feed speeds (Stribeck)"},
    {"presliding", "friction that builds up over a short travel after every reversal"},
    {"asymmetric_friction", "friction that differs between the two directions"},
    {"position_dependent_friction", "friction that depends on the position of the axis"},
    {"added_friction", "added friction"},
    {"backlash", "play (backlash)"},
    {"compliance", "an elastic part that oscillates when the axis accelerates"},
    {"cogging", "a force ripple that repeats along the axis"},
    {"lead_error", "a pitch error of screw or gear"},
    {"encoder_error", "an error of the encoder that repeats along the axis"},
    {"gravity_offset", "a constant force (weight, counterbalance, cable)"},
    {"inertia_change", "a moved mass that changed"},
    {"viscous_drift", "friction that changes as the axis warms up"},
    {"time_delay", "a delay between command and encoder"},
    {"feedforward_mismatch", "a feed-forward that differs from that of the model"},
    {"gain_change", "a position loop gain that changed"},
    {"torque_saturation", "a motor at its torque limit"},
    {"periodic_disturbance", "a vibration from an external source"},
    {"impulse_disturbance", "single impulses"},
    {"cutting_force", "the cutting force"},
    {"cross_coupling", "a force from the acceleration of the other axis"},
    {"dwell_stiction", "higher breakaway force after a rest"},
    {"thermal_growth", "thermal growth of screw or gear"},
    {"dropped_samples", "samples lost by the recorder"},
}};

/// By how much the friction in one direction exceeds that in the other.
std::string unlike_directions(double creeping, double per_speed, const char* force, bool rotary) {
  const auto way = [](double more) { return more > 0.0 ? "forwards" : "backwards"; };
  const bool alike = creeping * per_speed > 0.0;
  return std::string(way(creeping)) +
         text(" the axis needs %.3g %s more at creeping speed, and %s%.3g more for every %s",
              std::abs(creeping), force, alike ? "" : (std::string(way(per_speed)) + " ").c_str(),
              (rotary ? 1.0 : 0.1) * std::abs(per_speed), rotary ? "rad/s" : "100 mm/s");
}

}  // namespace

std::string plain_name(const std::string& id, bool rises) {
  if (id == "stribeck" && rises)
    return "friction that is lower at creeping speed than at feed speed";
  for (const auto& [key, name] : kNames) {
    if (id == key) return name;
  }
  return id;
}

std::string plain_name(const Diagnosis& diagnosis, const Cause& cause) {
  const std::vector<Effect>& effects = diagnosis.extended.model.effects;
  const bool swings = cause.id == "gravity_offset" && cause.place < effects.size() &&
                      effects[cause.place].kind == kind_of<SwingingLoad>();
  if (cause.id == "cross_coupling" && !diagnosis.baseline.neighbour.empty())
    return "a force from the acceleration of axis " + diagnosis.baseline.neighbour;
  return swings ? "the weight of a load that swings with it"
                : plain_name(cause.id, friction_rises(diagnosis, cause));
}

std::string plain_size(const Diagnosis& diagnosis, const Cause& cause) {
  const json file = to_json(diagnosis, "");
  json parameters;
  for (const json& one : file.at("causes")) {
    if (one.at("id") == cause.id) parameters = one.at("parameters");
  }
  const auto of = [&](const char* key) {
    return parameters.contains(key) && parameters.at(key).is_number()
               ? parameters.at(key).get<double>()
               : kAbsent;
  };
  const bool rotary = diagnosis.baseline.rotary;
  const char* force = rotary ? "N m per kg m^2" : "N per kg of moved mass";
  const char *length = milli(rotary), *unit = micro(rotary);
  const std::string& id = cause.id;
  const double period = 1e3 * (rotary ? of("period_rad") : of("period_m"));
  std::string out;
  if (id == "cogging")
    out = text("+-%.3g %s, every %.5g %s", of("amplitude_mps2"), force, period, length);
  if (id == "lead_error" || id == "encoder_error")
    out = text("+-%.3g %s, every %.5g %s", 1e6 * of("amplitude_m"), unit, period, length);
  if (id == "backlash") out = text("a gap of %.3g %s", 1e6 * of("width_m"), unit);
  if (id == "time_delay") out = text("%.3g ms", 1e3 * of("delay_s"));
  if (id == "gravity_offset" && std::isfinite(of("sine")))
    out = text("at most %.3g %s, as sine and cosine of the angle",
               std::hypot(of("sine"), of("cosine")), force);
  else if (id == "gravity_offset")
    out = text("%.3g %s", of("offset_mps2"), force);
  if (id == "inertia_change")
    out = text("%.3g times the %s from %.3g s on", of("ratio"), rotary ? "inertia" : "mass",
               of("time_s"));
  if (id == "gain_change")
    out = text("%.3g times the gain from %.3g s on", of("ratio"), of("time_s"));
  if (id == "added_friction")
    out = text("%.3g %s more from %.3g s on", of("coulomb"), force, of("time_s"));
  if (id == "periodic_disturbance")
    out = text("%.4g Hz, +-%.3g %s", of("frequency_hz"), of("amplitude_mps2"), force);
  if (id == "compliance" && std::isfinite(of("frequency_hz")))
    out = text("%.4g Hz, damping %.2g", of("frequency_hz"), of("damping_ratio"));
  if (id == "cutting_force")
    out = text("%.3g %s, teeth at %.4g Hz", of("mean"), force, of("tooth_frequency_hz"));
  if (id == "cross_coupling") out = text("%.2g %% of it", 100.0 * std::abs(of("ratio")));
  if (id == "torque_saturation") out = text("at most %.3g %s", of("limit_mps2"), force);
  if (id == "viscous_drift")
    out = text("decays with a time constant of %.3g s", of("time_constant_s"));
  if (id == "thermal_growth")
    out = text("%.3g %s per %s, with a time constant of %.3g s", 1e6 * of("growth"), unit,
               rotary ? "rad" : "m", of("time_constant_s"));
  if (id == "asymmetric_friction")
    out = unlike_directions(2.0 * of("coulomb_difference"), 2.0 * of("viscous_difference"), force,
                            rotary);
  if (id == "stribeck" && std::isfinite(of("drop")))
    out =
        text("%.3g %s %s at creeping speed, no effect above about %.3g %s/s", std::abs(of("drop")),
             force, of("drop") > 0.0 ? "more" : "less", 3e3 * of("stribeck_velocity"), length);
  if (id == "stribeck" && std::isfinite(of("breakaway_ratio")))
    out = text("%.3g times as high at creeping speed, no effect above about %.3g %s/s",
               of("breakaway_ratio"), 3e3 * of("stribeck_velocity"), length);
  if (id == "dwell_stiction")
    out = text("%.3g %s more after ten times the rest, gone again within about %.3g %s",
               std::log(10.0) * of("growth"), force, 1e6 * of("length"), unit);
  if (id == "impulse_disturbance") {
    double most = 0.0;  // of all four, which the effect has
    std::string times;
    for (int i = 1; i <= 4; ++i) {
      const std::string n = std::to_string(i);
      most = std::max(most, std::abs(of(("push_" + n).c_str())));
      times += (i == 1   ? ""
                : i == 4 ? " and "
                         : ", ") +
               text("%.4g", of(("time_" + n + "_s").c_str()));
    }
    out = text("pushes of at most %.3g %s, at ", most, force) + times + " s";
  }
  if (id == "presliding") {
    double level = std::isfinite(of("breakaway")) ? of("breakaway") : of("coulomb");
    double way = std::isfinite(of("breakaway_displacement")) ? of("breakaway_displacement")
                                                             : of("deflection");
    if (std::isfinite(of("level_1"))) {  // all elements slide
      level = 0.0;
      way = std::isfinite(of("last_displacement")) ? of("last_displacement")
                                                   : of("first_displacement");
      for (const auto& [key, value] : parameters.items()) {
        if (key.rfind("level_", 0) == 0 && value.is_number()) level += value.get<double>();
        if (key.rfind("step_", 0) == 0 && value.is_number()) way *= value.get<double>();
      }
    }
    out = text("%.3g %s, built up within about %.3g %s", level, force, 1e6 * way, unit);
  }
  // A key that this effect does not have would print as nan.
  if (out.empty() || out.find("nan") != std::string::npos) out = cause_text(diagnosis, cause);
  return out;
}

namespace {

/// What a repair of this cause would change: the contour error if it is known, else the tracking
/// error. Empty where no repair was simulated.
std::string worth_of_repair(const Gain& gain, bool rotary) {
  const bool path = std::isfinite(gain.contour_repaired);
  const double now = path ? gain.contour_now : gain.tracking_now,
               then = path ? gain.contour_repaired : gain.tracking_repaired;
  if (!std::isfinite(now) || !std::isfinite(then)) return {};
  const char *what = path ? "contour error" : "tracking error",
             *unit = micro(path ? false : rotary);
  if (!worth_a_repair(gain))
    return text(" Its repair would not lower the %s of this motion, %s RMS.", what,
                micro_text(now, !path && rotary, 3).c_str());
  return text(" Without it the %s of this motion would be %.3g %s RMS instead of %.3g.", what,
              1e6 * then, unit, 1e6 * now);
}

}  // namespace

namespace {

/// ", 0.7 % of the tracking error": whether it matters.
std::string share_of_tracking(double error, const CommandLag& lag) {
  if (!(lag.tracking_rms > error)) return {};
  return text(", %.2g %% of the tracking error", 100.0 * error / lag.tracking_rms);
}

}  // namespace

std::string plain_verdict(const Diagnosis& diagnosis, const std::vector<Shown>& by_torque) {
  std::string axis = "Axis " + diagnosis.baseline.axis;
  if (diagnosis.against_earlier) return axis + ": " + verdict_text(diagnosis) + ".";
  const bool limited = !diagnosis.at_limit.empty();
  if (limited) {
    axis += " asks its motor for more than it can give: the motor stays at " + diagnosis.at_limit +
            ". Check first: " + advice_for("torque_saturation") + ". " +
            (diagnosis.limit_left_out ? "Away from these moments the" : "The") + " axis";
  }
  const double before = 1e6 * diagnosis.baseline.holdout.rms,
               after = 1e6 * diagnosis.extended.holdout.rms;
  const char* unit = micro(diagnosis.baseline.rotary);
  std::string shown;
  for (const Shown& one : by_torque) shown += (shown.empty() ? "" : "; ") + one.name;
  if (!shown.empty()) shown = " The torque shows " + shown + ".";
  // Where the position names no cause, what to check first is that of the torque.
  const std::string of_torque =
      by_torque.empty()
          ? ""
          : shown + (limited ? " Then check: " : " Check first: ") + by_torque.front().check + ".";
  switch (diagnosis.verdict) {
    case Verdict::kNothingSignificant:
      return axis +
             text(" agrees with its simulation to %s RMS",
                  micro_text(1e-6 * before, diagnosis.baseline.rotary, 3).c_str()) +
             (by_torque.empty() ? ": no cause needs to be looked for." : "." + of_torque);
    case Verdict::kUnexplained: {
      std::string named;
      for (const Cause& cause : diagnosis.causes)
        if (!cause.counted()) named += (named.empty() ? "" : "; ") + plain_name(diagnosis, cause);
      // Of the tracking error: a model of an axis seldom leaves less, with its causes known.
      constexpr double kSmallShare = 0.01;
      if (named.empty() && 1e-6 * before < kSmallShare * diagnosis.lag.tracking_rms) {
        return axis +
               text(" follows its simulation but for %s RMS",
                    micro_text(1e-6 * before, diagnosis.baseline.rotary, 3).c_str()) +
               share_of_tracking(1e-6 * before, diagnosis.lag) +
               "; that rest is more than noise, and none of the known causes explains it." +
               of_torque;
      }
      return axis + " deviates from its simulation in a way that " +
             (named.empty() ? "none of the known causes explains"
                            : "is explained only in part, by " + named) +
             text(": the error is %s RMS",
                  micro_text(1e-6 * before, diagnosis.baseline.rotary, 3).c_str()) +
             share_of_tracking(1e-6 * before, diagnosis.lag) + "." +
             (named.empty() ? of_torque : shown);
    }
    case Verdict::kExplained:
      break;
  }
  const Cause& first = diagnosis.causes.front();
  std::string out = axis + " has " + plain_name(diagnosis, first) + ": " +
                    plain_size(diagnosis, first) + "." +
                    worth_of_repair(first.gain, diagnosis.baseline.rotary);
  if (first.id == "presliding")
    out += " Every axis has such friction: it calls for action where it has grown.";
  if (diagnosis.causes.size() > 1) {
    out += " Further causes: ";
    for (std::size_t i = 1; i < diagnosis.causes.size(); ++i)
      out += (i > 1 ? "; " : "") + plain_name(diagnosis, diagnosis.causes[i]);
    out += ".";
  }
  out += shown;
  if (std::isfinite(before) && after < before) {
    const double explained = 1.0 - diagnosis.unexplained_share;
    constexpr double kShareRoundedToAll = 0.995;  // "%.0f %%" prints it as 100 %
    out +=
        " The extended model explains " +
        (explained > kShareRoundedToAll ? std::string("over 99 %")
                                        : text("%.0f %%", 100.0 * explained)) +
        text(" of what was unexplained: the simulation error is now %.3g %s RMS instead of %.3g.",
             after, unit, before);
  }
  if (const std::string advice = advice_for(diagnosis, first); !advice.empty())
    out += std::string(limited ? " Then check: " : " Check first: ") + advice + ".";
  return out;
}

}  // namespace servotwin
