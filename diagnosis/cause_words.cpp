#include "diagnosis/cause_words.h"

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "diagnosis/diagnosis_file.h"
#include "diagnosis/text.h"

namespace servotwin {

namespace {

using nlohmann::json;

constexpr std::array<std::pair<const char*, const char*>, 24> kNames{{
    {"stribeck", "friction that changes between creeping and feed"},
    {"presliding", "friction that builds up over a short way after every reversal"},
    {"asymmetric_friction", "friction unlike in the two directions"},
    {"position_dependent_friction", "friction that depends on where the axis stands"},
    {"added_friction", "friction that was added"},
    {"backlash", "play (backlash)"},
    {"compliance", "a part that swings when the axis accelerates"},
    {"cogging", "a force ripple that repeats along the axis"},
    {"lead_error", "an error of the screw's pitch"},
    {"encoder_error", "an error of the encoder that repeats along the axis"},
    {"gravity_offset", "a constant force (weight, counterbalance, cable)"},
    {"inertia_change", "a moved mass that changed"},
    {"viscous_drift", "friction that changes as the axis warms up"},
    {"time_delay", "an encoder record that lags the command record"},
    {"feedforward_mismatch", "a feed-forward other than the model's"},
    {"gain_change", "a position loop gain that changed"},
    {"torque_saturation", "a motor at its limit"},
    {"periodic_disturbance", "a vibration from outside"},
    {"impulse_disturbance", "single pushes"},
    {"cutting_force", "the force of the cut"},
    {"cross_coupling", "a push by the other axis when that accelerates"},
    {"dwell_stiction", "sticking after a rest"},
    {"thermal_growth", "a screw that grows as it warms up"},
    {"dropped_samples", "samples lost by the recorder"},
}};

/// What one direction needs more than the other.
std::string unlike_directions(double creeping, double per_speed, const char* force, bool rotary) {
  const auto way = [](double more) { return more > 0.0 ? "forwards" : "backwards"; };
  const bool alike = creeping * per_speed > 0.0;
  return std::string(way(creeping)) +
         text(" it needs %.3g %s more at creeping speed, and %s%.3g more for every %s",
              std::abs(creeping), force, alike ? "" : (std::string(way(per_speed)) + " ").c_str(),
              (rotary ? 1.0 : 0.1) * std::abs(per_speed), rotary ? "rad/s" : "100 mm/s");
}

}  // namespace

std::string plain_name(const std::string& id) {
  for (const auto& [key, name] : kNames) {
    if (id == key) return name;
  }
  return id;
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
  const char* milli = rotary ? "mrad" : "mm";
  const char* micro = rotary ? "urad" : "um";
  const std::string& id = cause.id;
  const double period = 1e3 * (rotary ? of("period_rad") : of("period_m"));
  std::string out;
  if (id == "cogging")
    out = text("+-%.3g %s, every %.5g %s", of("amplitude_mps2"), force, period, milli);
  if (id == "lead_error" || id == "encoder_error")
    out = text("+-%.3g %s, every %.5g %s", 1e6 * of("amplitude_m"), micro, period, milli);
  if (id == "backlash") out = text("a gap of %.3g %s", 1e6 * of("width_m"), micro);
  if (id == "time_delay") out = text("%.3g ms", 1e3 * of("delay_s"));
  if (id == "gravity_offset") out = text("%.3g %s", of("offset_mps2"), force);
  if (id == "inertia_change")
    out = text("%.3g times the mass from %.3g s on", of("ratio"), of("time_s"));
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
  if (id == "cross_coupling")
    out = text("%.2g %% of the other axis' acceleration", 100.0 * std::abs(of("ratio")));
  if (id == "torque_saturation") out = text("no more than %.3g %s", of("limit_mps2"), force);
  if (id == "viscous_drift")
    out = text("fades with a time constant of %.3g s", of("time_constant_s"));
  if (id == "thermal_growth")
    out = text("%.3g um per m, with a time constant of %.3g s", 1e6 * of("growth"),
               of("time_constant_s"));
  if (id == "asymmetric_friction")
    out = unlike_directions(2.0 * of("coulomb_difference"), 2.0 * of("viscous_difference"), force,
                            rotary);
  if (id == "stribeck" && std::isfinite(of("drop")))
    out = text("%.3g %s %s at creeping speed, gone above some %.3g %s/s", std::abs(of("drop")),
               force, of("drop") > 0.0 ? "more" : "less", 3e3 * of("stribeck_velocity"), milli);
  if (id == "stribeck" && std::isfinite(of("breakaway_ratio")))
    out = text("%.3g times as high at creeping speed, gone above some %.3g %s/s",
               of("breakaway_ratio"), 3e3 * of("stribeck_velocity"), milli);
  if (id == "presliding") {
    const double level = std::isfinite(of("breakaway")) ? of("breakaway") : of("coulomb");
    const double way = std::isfinite(of("breakaway_displacement")) ? of("breakaway_displacement")
                                                                   : of("deflection");
    out = text("%.3g %s, built up within some %.3g %s", level, force, 1e6 * way, micro);
  }
  // A key that this effect does not have would be no number.
  if (out.empty() || out.find("nan") != std::string::npos) out = cause_text(diagnosis, cause);
  return out;
}

std::string plain_verdict(const Diagnosis& diagnosis) {
  const std::string axis = "Axis " + diagnosis.baseline.axis;
  if (diagnosis.against_earlier) return axis + ": " + verdict_text(diagnosis) + ".";
  const double before = 1e6 * diagnosis.baseline.holdout.rms,
               after = 1e6 * diagnosis.extended.holdout.rms;
  const char* micro = diagnosis.baseline.rotary ? "urad" : "um";
  switch (diagnosis.verdict) {
    case Verdict::kNothingSignificant:
      return axis +
             text(" does what its simulation says, to %.3g %s: there is nothing to look for.",
                  before, micro);
    case Verdict::kUnexplained:
      return axis + text(" does something that %s: its simulation is wrong by %.3g %s.",
                         diagnosis.causes.empty() ? "none of the known causes explains"
                                                  : "the causes below explain but a part of",
                         before, micro);
    case Verdict::kExplained:
      break;
  }
  const Cause& first = diagnosis.causes.front();
  std::string out =
      axis + " has " + plain_name(first.id) + ": " + plain_size(diagnosis, first) + ".";
  if (diagnosis.causes.size() > 1) {
    out += " Beside it: ";
    for (std::size_t i = 1; i < diagnosis.causes.size(); ++i)
      out += (i > 1 ? "; " : "") + plain_name(diagnosis.causes[i].id);
    out += ".";
  }
  if (std::isfinite(before) && after < before)
    out += text(
        " That explains %.0f %% of what was unexplained: the simulation is now right to "
        "%.3g %s in place of %.3g.",
        100.0 * (1.0 - diagnosis.unexplained_share), after, micro, before);
  if (const std::string advice = advice_for(first.id); !advice.empty())
    out += " Look first at: " + advice + ".";
  return out;
}

}  // namespace servotwin
