#include "diagnosis/report/torque_text.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "diagnosis/report/diagnosis_file.h"
#include "diagnosis/report/plot.h"
#include "diagnosis/statistics/text.h"
#include "identification/model/json_number.h"
#include "twin/catalogue.h"
#include "twin/shown_units.h"

namespace servotwin {

namespace {

using nlohmann::json;

json harmonics_of(const TorqueDiagnosis& torque, const TorqueCause& cause) {
  const std::string unit = key_of_unit(torque.unit), length = torque.rotary ? "rad" : "m";
  json out = json::array();
  for (const Harmonic& harmonic : cause.harmonics) {
    json one = {{"period_" + length, harmonic.period},
                {"amplitude_" + unit, harmonic.amplitude},
                {"tracking_error_" + length, number_or_null(harmonic.tracking_error)}};
    if (torque.rotary) one["order_per_rev"] = 2.0 * std::numbers::pi / harmonic.period;
    out.push_back(std::move(one));
  }
  return out;
}

std::string doubt_text(const TorqueCause& cause, const std::string& unit) {
  if (cause.doubt == TorqueDoubt::kParameters)
    return "not confirmed: the fit gives it impossible parameters";
  if (cause.doubt == TorqueDoubt::kGain) {
    if (cause.gain.low > 0.0)
      return text("not confirmed: it leaves %.3g %% of the residual on held-out motion",
                  100.0 * cause.gain.after / cause.gain.before);
    return std::isfinite(cause.gain.low)
               ? text("not confirmed: its gain on held-out motion is %.2g to %.2g %s",
                      cause.gain.low, cause.gain.high, unit.c_str())
               : std::string("not confirmed: too little held-out motion");
  }
  if (cause.doubt == TorqueDoubt::kPosition)
    return "the position shows " + cause.same_by_position + ", which does the same in the torque";
  return text("confidence %.0f %%, too low to name it", 100.0 * cause.confidence);
}

const char* key_of(TorqueDoubt doubt) {
  switch (doubt) {
    case TorqueDoubt::kConfidence:
      return "confidence";
    case TorqueDoubt::kGain:
      return "holdout_gain";
    case TorqueDoubt::kParameters:
      return "parameters";
    case TorqueDoubt::kPosition:
      return "position";
    case TorqueDoubt::kNone:
      break;
  }
  return "none";
}

std::string suspected_of(const TorqueCause& cause, const std::string& unit) {
  std::string out = "suspected   by torque " + cause.id + ": " + doubt_text(cause, unit);
  for (const std::string& rival : cause.ambiguous_with) {
    if (rival != cause.same_by_position) out += "; the torque does not tell it from " + rival;
  }
  return out;
}

/// Torque residual on the hold-out without the cause and with it. A limit that the hold-out does
/// not reach has none.
std::string gain_text(const TorqueCause& cause, const std::string& unit) {
  if (!std::isfinite(cause.gain.before)) return "seen in the torque itself";
  return text("%.4g -> %.4g %s without and with it", cause.gain.before, cause.gain.after,
              unit.c_str());
}

/// The scale of a rest that is not explained.
std::string noise_of(const TorqueDiagnosis& torque) {
  if (!std::isfinite(torque.noise_rms)) return {};
  return text(" (noise %.2g %s)", torque.noise_rms, torque.unit.c_str());
}

/// The scale of what the rigid body leaves.
std::string of_scatter(const TorqueDiagnosis& torque) {
  if (torque.torque.size() == 0) return {};
  const double scatter = std::sqrt((torque.torque.array() - torque.torque.mean()).square().mean());
  return text(" of a scatter of %.3g", scatter);
}

std::string verdict_of(const TorqueDiagnosis& torque) {
  const std::size_t n = torque.causes.size();
  const std::string left = text("%.3g %s RMS", torque.baseline_rms, torque.unit.c_str());
  const bool limited = n > 0 && torque.causes.front().id == "torque_saturation";
  if (n == 1 && limited)
    return "1 cause named, which is no part of the model; the residual of the rigid body on "
           "held-out motion is " +
           left;
  const std::string turns =
      torque.held_out_turns ? ", where the axis moves the other way than in the training data" : "";
  if (n == 0)
    return "nothing significant: the residual of the rigid body on held-out motion is " + left +
           of_scatter(torque) + turns;
  return text("%zu cause%s named: the residual on held-out motion is %.3g %s RMS instead of %s", n,
              n == 1 ? "" : "s", torque.extended_rms, torque.unit.c_str(),
              text("%.3g", torque.baseline_rms).c_str()) +
         (explained(torque) ? "" : "; the rest is not explained" + noise_of(torque));
}

std::string body_of(const TorqueDiagnosis& torque) {
  const char *unit = torque.unit.c_str(), *length = torque.rotary ? "rad" : "m";
  const auto shown = [](const char* name, double value, const std::string& of) {
    return value > 0.0 ? text("%s %.4g ", name, value) + of : std::string(name) + " not shown";
  };
  const std::string per_speed = std::string(unit) + " s/" + length;
  return shown(torque.rotary ? "inertia" : "mass", torque.mass_shown ? torque.mass : 0.0,
               std::string(unit) + " s^2/" + length) +
         ", " +
         (torque.constant != 0.0
              ? text("friction and constant force together %.4g %s (motion in one direction does "
                     "not separate them)",
                     torque.constant, unit)
              : shown("Coulomb", torque.coulomb, unit)) +
         ", " + shown("viscous", torque.viscous, per_speed) +
         (torque.gravity > 0.0
              ? text(", gravity %.4g %s at %.3g rad", torque.gravity, unit, torque.gravity_at_rad)
              : "");
}

const char* kAgainst =
    "has the opposite sign to the position: a positive torque drives the axis backwards; a "
    "constant force is given with its recorded sign";

std::string lag_of(const TorqueLag& lag) {
  return text("is recorded %.3g ms %s the motion (%s), and was put in time", 1e3 * std::abs(lag.s),
              lag.s > 0.0 ? "behind" : "ahead of",
              lag.filter ? "a filter of the drive"
              : lag.s > 0.0
                  ? "a later cycle"
                  : "the torque that was asked for, or a position that is recorded later");
}

bool narrowed(const TorqueDiagnosis& torque) { return torque.bandwidth_hz < torque.widest_hz; }
std::string band_of(const TorqueDiagnosis& torque) {
  return text(
      "is compared with the motion up to %.3g Hz only: above that the encoder does not "
      "show the acceleration",
      torque.bandwidth_hz);
}

bool friction_rises(const TorqueCause& cause) {
  return cause.id == "stribeck" && !cause.parameters.empty() &&
         cause.parameters.front().second < 0.0;
}

std::string name_of(const TorqueCause& cause) {
  return plain_name(cause.id, friction_rises(cause));
}

/// What to check for this cause. In the torque, backlash may be anywhere between motor and load.
std::string check_of(const TorqueCause& cause) {
  if (cause.id == "backlash") return std::string(identity_of(kind_of<BacklashInLoop>()).check);
  return advice_for(cause.id, friction_rises(cause));
}

/// "breakaway 0.381 Nm" of breakaway_nm, "width forward 2.02 mm" of width_forward.
std::string size_of(const TorqueDiagnosis& torque, std::string name, double value) {
  struct Unit {
    std::string ending;  ///< of the name
    bool part;           ///< of the name: it is kept
    std::string unit;
    double scale;
  };
  const std::string length = torque.rotary ? "rad" : "mm",
                    viscous = torque.unit + (torque.rotary ? " s/rad" : " s/m");
  const double to_mm = torque.rotary ? 1.0 : 1e3;
  const std::array units{Unit{"_" + key_of_unit(torque.unit), false, torque.unit, 1.0},
                         Unit{"_m", false, "mm", 1e3},
                         Unit{"_rad", false, "rad", 1.0},
                         Unit{"_s", false, "s", 1.0},
                         Unit{"_hz", false, "Hz", 1.0},
                         Unit{"displacement", true, length, to_mm},
                         Unit{"deviation", true, length, to_mm},
                         Unit{"forward", true, length, to_mm},
                         Unit{"backward", true, length, to_mm},
                         Unit{"length", true, length, to_mm},
                         Unit{"velocity", true, length + "/s", to_mm},
                         Unit{"viscous", true, viscous, 1.0},
                         Unit{"viscous_plus", true, viscous, 1.0},
                         Unit{"viscous_minus", true, viscous, 1.0}};
  const auto found = std::find_if(units.begin(), units.end(),
                                  [&](const Unit& unit) { return name.ends_with(unit.ending); });
  std::string unit;
  if (found != units.end()) {
    unit = " " + found->unit;
    value *= found->scale;
    if (!found->part) name.resize(name.size() - found->ending.size());
  }
  std::replace(name.begin(), name.end(), '_', ' ');
  return name + text(" %.4g", value) + unit;
}

std::string sizes_of(const TorqueDiagnosis& torque, const TorqueCause& cause) {
  std::string out;
  for (const auto& [name, value] : cause.parameters)
    out += (out.empty() ? "" : ", ") + size_of(torque, name, value);
  return out;
}

std::string line_of(const TorqueDiagnosis& torque, const Harmonic& harmonic) {
  std::string out =
      torque.rotary ? text("order %4.3g per revolution", 2.0 * std::numbers::pi / harmonic.period)
                    : text("period %.5g mm", 1e3 * harmonic.period);
  out += text(": %.4g %s", harmonic.amplitude, torque.unit.c_str());
  if (std::isfinite(harmonic.tracking_error)) {
    out += text(", tracking error %.4g %s", 1e6 * harmonic.tracking_error, micro(torque.rotary));
  }
  return out;
}

std::string picture(const TorqueDiagnosis& torque) {
  PlotSeries measured{"measured", {}, {}, false, ""}, before{"rigid body", {}, {}, false, ""},
      after{"with the causes", {}, {}, false, ""};
  for (Eigen::Index k = 0; k < torque.time.size(); ++k) {
    const double t = torque.time(k);
    measured.x.push_back(t);
    measured.y.push_back(torque.torque(k));
    before.x.push_back(t);
    before.y.push_back(torque.left_before(k));
    after.x.push_back(t);
    after.y.push_back(torque.left_after(k));
  }
  if (measured.x.empty()) return {};
  const std::string unit = "[" + torque.unit + "]";
  std::vector<PlotPanel> panels{
      {"torque", "time [s]", unit, false, {measured}},
      {"residual (measured minus modelled)", "time [s]", unit, false, {before, after}}};
  if (torque.plateau.found()) {
    // Backlash shows as a plateau: the force stays near zero while the axis moves.
    measured.x.clear();
    for (const double x : torque.position) measured.x.push_back(1e3 * x);
    panels.push_back({"torque over position",
                      torque.rotary ? "position [mrad]" : "position [mm]",
                      unit,
                      false,
                      {measured}});
  }
  return plot_svg(panels);
}

}  // namespace

Shown as_shown(const TorqueCause& cause) { return {name_of(cause), check_of(cause)}; }

void add_torque(json& file, const TorqueDiagnosis& torque) {
  const std::string unit = key_of_unit(torque.unit);
  for (const TorqueCause& cause : torque.causes) {
    json evidence = json::array();
    for (const TorqueEvidence& one : cause.evidence) {
      evidence.push_back(
          {{"test", one.test}, {"statistic", one.statistic}, {"p", number_or_null(one.p)}});
    }
    json parameters = json::object();
    for (const auto& [name, value] : cause.parameters) parameters[name] = number_or_null(value);
    if (!cause.harmonics.empty()) parameters["harmonics"] = harmonics_of(torque, cause);
    const json gain = {
        {"holdout_rms_before_" + unit, number_or_null(cause.gain.before)},
        {"holdout_rms_after_" + unit, number_or_null(cause.gain.after)},
        {"ci95_" + unit, {number_or_null(cause.gain.low), number_or_null(cause.gain.high)}}};
    json* known = nullptr;
    for (json& other : file["causes"]) {
      if (other["id"] == cause.id) known = &other;
    }
    if (known != nullptr) {
      for (json& one : evidence) (*known)["evidence"].push_back(std::move(one));
      for (const auto& [name, value] : parameters.items()) {
        if (!(*known)["parameters"].contains(name)) (*known)["parameters"][name] = value;
      }
      (*known)["gain"].update(gain);
      continue;
    }
    json whole = {{"holdout_rms_before_m", json()},
                  {"holdout_rms_after_m", json()},
                  {"ci95", {json(), json()}}};
    whole.update(gain);
    // The verdict begins with the limit as well: it is seen, and the rest is judged away from it.
    json& causes = file["causes"];
    json told = {{"id", cause.id},           {"confidence", cause.confidence},
                 {"parameters", parameters}, {"ambiguous_with", cause.ambiguous_with},
                 {"evidence", evidence},     {"gain", whole},
                 {"check", check_of(cause)}, {"page", cause_page(cause.id)}};
    causes.insert(cause.id == "torque_saturation" ? causes.begin() : causes.end(), std::move(told));
  }
  for (const TorqueCause& cause : torque.suspected)
    file["suspected"].push_back({{"id", cause.id},
                                 {"confidence", cause.confidence},
                                 {"ambiguous_with", cause.ambiguous_with},
                                 {"doubt", key_of(cause.doubt)}});
  if (!torque.causes.empty() && file["verdict"] == "nothing_significant")
    file["verdict"] = explained(torque) ? "explained" : "unexplained";
  file["torque"] = {{"unit", torque.unit},
                    {"counts_against_position", torque.opposite},
                    {"lag_s", torque.lag.s},
                    {"bandwidth_hz", torque.bandwidth_hz},
                    {"lag_by_filter", torque.lag.filter},
                    {"training_to_s", torque.training_to_s},
                    {"baseline",
                     {{"rms_" + unit, number_or_null(torque.baseline_rms)},
                      {"mass", torque.mass},
                      {"mass_shown", torque.mass_shown},
                      {"coulomb_" + unit, torque.coulomb},
                      {"viscous", torque.viscous},
                      {"constant_" + unit, torque.constant},
                      {"gravity_" + unit, torque.gravity},
                      {"gravity_at_rad", torque.gravity_at_rad}}},
                    {"extended", {{"rms_" + unit, number_or_null(torque.extended_rms)}}}};
}

json torque_alone(const TorqueDiagnosis& torque, const std::string& reason) {
  json out = {{"schema", "servotwin.diagnosis/1"},
              {"axis", torque.axis},
              {"baseline",
               {{"rms_m", json()},
                {"max_m", json()},
                {"noise_floor_rms_m", json()},
                {"noise_floor_interval_m", json()}}},
              {"extended", {{"rms_m", json()}, {"max_m", json()}}},
              {"verdict", "nothing_significant"},
              {"causes", json::array()},
              {"suspected", json::array()},
              {"not_observable", json::array()},
              {"residual", {{"by_regime", json::object()}, {"unexplained_share", json()}}},
              {"extended_model", json()},
              {"position_loop", reason}};
  add_torque(out, torque);
  return out;
}

std::string torque_beside(const TorqueDiagnosis& torque, const std::string& id) {
  for (const TorqueCause& cause : torque.causes) {
    if (cause.id != id) continue;
    std::string out = "by torque as well: " + gain_text(cause, torque.unit) +
                      text(", confidence %.0f %%", 100.0 * cause.confidence);
    if (const std::string sizes = sizes_of(torque, cause); !sizes.empty()) out += "; " + sizes;
    return out;
  }
  return {};
}

std::vector<std::string> torque_lines(const TorqueDiagnosis& torque, bool details,
                                      const std::vector<std::string>& told) {
  std::vector<std::string> out{"torque      " + verdict_of(torque),
                               "torque      rigid body: " + body_of(torque)};
  if (torque.opposite) out.push_back(std::string("torque      ") + kAgainst);
  if (torque.lag.s != 0.0) out.push_back("torque      " + lag_of(torque.lag));
  if (narrowed(torque)) out.push_back("torque      " + band_of(torque));
  for (const TorqueCause& cause : torque.causes) {
    if (std::find(told.begin(), told.end(), cause.id) != told.end()) continue;
    out.push_back(text("by torque   %-24s ", cause.id.c_str()) + gain_text(cause, torque.unit) +
                  (std::isfinite(cause.gain.low) ? text(" (gain %.2g to %.2g %s)", cause.gain.low,
                                                        cause.gain.high, torque.unit.c_str())
                                                 : "") +
                  text(", confidence %.0f %%", 100.0 * cause.confidence));
    out.push_back("              " + sizes_of(torque, cause));
    for (const Harmonic& harmonic : cause.harmonics)
      out.push_back("              " + line_of(torque, harmonic));
    for (const std::string& rival : cause.ambiguous_with) {
      out.push_back(
          "              not distinguishable from " + rival + " with this recording" +
          (rival == "periodic_disturbance" ? ": it has only one speed; record a second one" : ""));
    }
    if (const std::string advice = check_of(cause); !advice.empty())
      out.push_back("              check " + advice);
    out.push_back("              see " + page_to_read(cause.id));
  }
  for (const TorqueCause& cause : torque.suspected) out.push_back(suspected_of(cause, torque.unit));
  if (details) {
    for (const std::string& step : torque.steps) out.push_back("by torque   " + step);
  }
  return out;
}

std::string torque_section(const TorqueDiagnosis& torque) {
  std::string out = "<h2>Torque</h2>\n<p>" + escaped(verdict_of(torque)) +
                    ".</p>\n<p>Rigid body: " + escaped(body_of(torque)) + ".</p>\n";
  if (torque.opposite) out += std::string("<p>The recorded torque ") + kAgainst + ".</p>\n";
  if (torque.lag.s != 0.0) out += "<p>The torque " + lag_of(torque.lag) + ".</p>\n";
  if (narrowed(torque)) out += "<p>The torque " + band_of(torque) + ".</p>\n";
  out += picture(torque);
  for (const TorqueCause& cause : torque.suspected)
    out += "<p>" + escaped(suspected_of(cause, torque.unit)) + ".</p>\n";
  if (torque.causes.empty()) return out;
  out +=
      "<table><tr><th>cause</th><th>size</th><th>torque residual without it</th><th>with it</th>"
      "<th>gain, 95 %</th><th>confidence</th><th>what to check</th></tr>\n";
  for (const TorqueCause& cause : torque.causes) {
    std::string sizes = escaped(sizes_of(torque, cause));
    for (const Harmonic& harmonic : cause.harmonics)
      sizes += "<br>" + escaped(line_of(torque, harmonic));
    out += "<tr><td>" + escaped(name_of(cause)) + "</td><td>" + sizes + "</td>" +
           (std::isfinite(cause.gain.before)
                ? text("<td>%.4g %s</td><td>%.4g %s</td><td>", cause.gain.before,
                       torque.unit.c_str(), cause.gain.after, torque.unit.c_str())
                : "<td></td><td></td><td>") +
           (std::isfinite(cause.gain.low)
                ? text("%.2g to %.2g %s", cause.gain.low, cause.gain.high, torque.unit.c_str())
                : "") +
           text("</td><td>%.0f %%", 100.0 * cause.confidence);
    for (const std::string& rival : cause.ambiguous_with)
      out += "<br>or " + escaped(plain_name(rival));
    out += "</td><td>" + escaped(check_of(cause)) + "; see <code>" + page_to_read(cause.id) +
           "</code></td></tr>\n";
  }
  return out + "</table>\n";
}

std::vector<std::string> in_short(const TorqueDiagnosis& torque, const std::string& reason) {
  std::vector<std::string> out;
  const std::string left = text("%.3g %s RMS", torque.baseline_rms, torque.unit.c_str());
  if (torque.causes.empty()) {
    out.push_back("No known cause stands out in the torque of axis " + torque.axis +
                  (torque.rotary ? "; inertia" : "; mass") + ", friction and weight leave " + left +
                  " of it on held-out motion.");
  } else {
    const TorqueCause& first = torque.causes.front();
    std::string line = "The torque of axis " + torque.axis + " shows " + name_of(first);
    if (!first.parameters.empty())
      line += " (" + size_of(torque, first.parameters[0].first, first.parameters[0].second) + ")";
    for (std::size_t i = 1; i < torque.causes.size(); ++i)
      line += (i == 1 ? "; further " : "; ") + name_of(torque.causes[i]);
    line += ".";
    if (std::isfinite(first.gain.before))
      line += text(" On held-out motion %.3g %s RMS of the torque are left instead of ",
                   torque.extended_rms, torque.unit.c_str()) +
              left +
              (explained(torque) ? "." : ": the rest is not explained" + noise_of(torque) + ".");
    if (const std::string advice = check_of(first); !advice.empty())
      line += " Check first: " + advice + ".";
    out.push_back(std::move(line));
  }
  out.push_back("How the axis follows its command was not judged: " + reason + ".");
  return out;
}

std::string torque_page(const TorqueDiagnosis& torque, const std::string& source,
                        const std::string& reason) {
  std::string sentences;
  for (const std::string& one : in_short(torque, reason))
    sentences += "<p>" + escaped(one) + "</p>\n";
  return "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'><meta name='viewport' "
         "content='width=device-width'>\n<title>Axis " +
         escaped(torque.axis) +
         "</title>\n<style>body{font:16px sans-serif;max-width:72rem;margin:2rem auto;padding:0 "
         "1rem;color-scheme:light "
         "dark}table{border-collapse:collapse;display:block;overflow-x:auto}"
         "code{overflow-wrap:anywhere}td,th{padding:.3rem .8rem;"
         "text-align:left;border-bottom:1px solid #8884}svg{max-width:100%;height:auto}</style>"
         "</head><body>\n<h1>Axis " +
         escaped(torque.axis) + "</h1>\n<p>" + escaped(source) + "</p>\n" + sentences +
         torque_section(torque) + "</body></html>\n";
}

}  // namespace servotwin
