#include "diagnosis/report/diagnosis_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>

#include "diagnosis/search/judgement.h"
#include "diagnosis/search/search.h"
#include "diagnosis/statistics/text.h"
#include "identification/loop/joint.h"
#include "identification/model/json_number.h"
#include "twin/effect.h"
#include "twin/shown_units.h"

namespace servotwin {

namespace {

using nlohmann::json;

/// Amplitudes of the fundamental and of the second harmonic.
std::array<double, 2> amplitudes(const Effect& cogging) {
  const auto& c = cogging.coefficient;
  return {std::hypot(c[0], c[1]), std::hypot(c[2], c[3])};
}

double ratio_of(const Model& model, const Effect& effect, const std::string& id) {
  const auto& c = effect.coefficient;
  if (id == "inertia_change") return 1.0 + c[0];
  if (id == "gain_change") {
    const auto& a = model.loop.denominator;
    return model.loop.order == 2 ? 1.0 - c[0] / a[1] : 1.0 - c[1] / a[2];
  }
  for (const Effect& other : model.effects) {
    const auto& kinds = friction_kinds();
    if (std::find(kinds.begin(), kinds.end(), other.kind) != kinds.end())
      return (level_of(other) + c[0]) / (level_of(other) - c[0]);
  }
  return kAbsent;
}

json parameters_json(const Diagnosis& diagnosis, const Cause& cause) {
  json out = json::object();
  for (const auto& [name, count] : cause.counts) out[name] = count;
  for (const Moved& moved : cause.moved) {
    out[moved.name] = moved.after;
    if (moved.before != 0.0 && cause.moved.size() == 1) out["ratio"] = moved.after / moved.before;
  }
  if (cause.place == kNoEffect) return out;
  const Model& model = diagnosis.extended.model;
  const Effect& effect = model.effects[cause.place];
  std::size_t i = 0;
  for (const Parameter& p : shapes_of(effect.kind)) {
    out[std::string(p.name)] = means_something(effect, p, model) ? json(effect.shape[i]) : json();
    ++i;
  }
  i = 0;
  for (const Parameter& p : coefficients_of(effect.kind)) {
    if (told_from_loop(p, model.loop.order)) out[std::string(p.name)] = effect.coefficient[i];
    ++i;
  }
  // The keys of the contract.
  if (cause.id == "cogging" || cause.id == "lead_error" || cause.id == "encoder_error")
    out[diagnosis.baseline.rotary ? "period_rad" : "period_m"] = effect.shape[0];
  const auto& c = effect.coefficient;
  if (cause.id == "cogging") {
    out["amplitude_mps2"] = amplitudes(effect)[0];
    out["amplitude_2_mps2"] = amplitudes(effect)[1];
  } else if (cause.id == "lead_error") {
    out["amplitude_m"] = std::hypot(c[1], c[2]);
  } else if (cause.id == "encoder_error") {
    out["amplitude_m"] = std::hypot(c[0], c[1]);
  } else if (cause.id == "periodic_disturbance") {
    out["amplitude_mps2"] = std::hypot(c[0], c[1]);
  } else if (cause.id == "backlash") {
    out["width_m"] = shape_of(model, effect.kind, "width");
  } else if (effect.kind == kind_of<Compliance>() && out["frequency_hz"].is_null()) {
    if (const std::optional<Vibration> vibration = vibration_of(model, effect)) {
      out["frequency_hz"] = vibration->frequency_hz;
      out["damping_ratio"] = vibration->damping_ratio;
    }
  } else if (cause.id == "inertia_change" || cause.id == "gain_change" ||
             cause.id == "asymmetric_friction") {
    out["ratio"] = ratio_of(model, effect, cause.id);
  }
  return out;
}

json cause_json(const Diagnosis& diagnosis, const Cause& cause) {
  json out = {
      {"id", cause.id},
      {"confidence", cause.confidence},
      {"parameters", parameters_json(diagnosis, cause)},
      {"ambiguous_with", cause.ambiguous_with},
      {"evidence", json::array({{{"test", diagnosis.against_earlier
                                              ? "free simulation, paired over 0.25 s"
                                              : "blocked cross-validation, paired over 0.25 s"},
                                 {"statistic", cause.statistic},
                                 {"p", number_or_null(cause.p)}}})},
      {"gain",
       {{"holdout_rms_before_m", number_or_null(cause.gain.before)},
        {"holdout_rms_after_m", number_or_null(cause.gain.after)},
        {"ci95", {number_or_null(cause.gain.low), number_or_null(cause.gain.high)}},
        {"tracking_rms_now_m", number_or_null(cause.gain.tracking_now)},
        {"tracking_rms_repaired_m", number_or_null(cause.gain.tracking_repaired)},
        {"contour_rms_now_m", number_or_null(cause.gain.contour_now)},
        {"contour_rms_repaired_m", number_or_null(cause.gain.contour_repaired)}}},
      {"check", advice_for(diagnosis, cause)},
      {"page", cause_page(cause.id)}};
  if (cause.doubt != CauseDoubt::kNone)
    out["doubt"] = cause.doubt == CauseDoubt::kGain ? "holdout_gain" : "parameters";
  if (!diagnosis.against_earlier) return out;
  json moved = json::array();
  for (const Moved& m : cause.moved)
    moved.push_back({{"name", m.name},
                     {"unit", m.unit},
                     {"before", m.before},
                     {"after", m.after},
                     {"deviation", number_or_null(m.deviation)}});
  out["moved"] = moved;
  return out;
}

json not_understood(const Diagnosis& diagnosis) {
  if (diagnosis.not_understood == kNoEffect) return nullptr;
  const Effect& effect = diagnosis.extended.model.effects[diagnosis.not_understood];
  return {{"id", identity_of(effect.kind).id},
          {"low", effect.shape[0]},
          {"high", effect.shape[1]},
          {"force_mps2", effect.coefficient}};
}

}  // namespace

json to_json(const Diagnosis& diagnosis, const std::string& extended_model) {
  const auto list = [&](const std::vector<Cause>& given) {
    json out = json::array();
    for (const Cause& cause : given) out.push_back(cause_json(diagnosis, cause));
    return out;
  };
  json not_observable = json::array();
  for (const NotObservable& one : diagnosis.not_observable)
    not_observable.push_back({{"id", one.id}, {"why", one.why}});
  json regimes = json::object();
  for (const RegimeShare& share : diagnosis.regimes) {
    regimes[std::string(name_of(share.regime))] = {{"rms_m", share.rms},
                                                   {"max_m", share.max},
                                                   {"time_share", share.time_share},
                                                   {"share", share.share}};
  }
  json regressors = json::object(), peaks = json::array();
  for (const RegressorShare& one : diagnosis.regressors) {
    json& to = regressors[std::string(name_of(one.regressor))];
    to = {{"share", one.share}, {"chance", one.chance}, {"significant", one.significant}};
    if (one.regressor == Regressor::kPositionInPeriod)
      to[diagnosis.baseline.rotary ? "period_rad" : "period_m"] = one.period;
  }
  for (const SpectrumPeak& peak : diagnosis.peaks)
    peaks.push_back({{"frequency_hz", peak.frequency_hz},
                     {"amplitude_m", peak.amplitude},
                     {"significance", peak.significance}});
  return {
      {"schema", "servotwin.diagnosis/1"},
      {"axis", diagnosis.baseline.axis},
      {"baseline",
       {{"rms_m", number_or_null(diagnosis.baseline.holdout.rms)},
        {"max_m", number_or_null(diagnosis.baseline.holdout.max)},
        {"training_to_s", diagnosis.baseline.training_to_s},
        {"noise_floor_rms_m", number_or_null(diagnosis.baseline.noise_floor.rms)},
        {"noise_floor_interval_m", interval_or_null(diagnosis.baseline.noise_floor)}}},
      {"extended",
       {{"rms_m", number_or_null(diagnosis.extended.holdout.rms)},
        {"max_m", number_or_null(diagnosis.extended.holdout.max)}}},
      {"verdict", name_of(diagnosis.verdict)},
      {"causes", list(diagnosis.causes)},
      {"suspected", list(diagnosis.suspected)},
      {"not_observable", not_observable},
      {"steps", diagnosis.steps},
      {"not_understood", not_understood(diagnosis)},
      {"residual",
       {{"by_regime", regimes},
        {"by_regressor", regressors},
        {"spectrum_peaks", peaks},
        {"unexplained_share", diagnosis.unexplained_share}}},
      {"suggested_test", diagnosis.suggested_test ? json(diagnosis.suggested_test->words) : json()},
      {"extended_model", extended_model.empty() ? json() : json(extended_model)}};
}

namespace {

/// Of the loop, away from a limit of the motor.
std::string verdict_of_loop(const Diagnosis& diagnosis) {
  constexpr double kMaxRmsRatioOfImprovement = 0.995;  // less is not seen in three digits
  const double before = 1e6 * diagnosis.baseline.holdout.rms,
               after = 1e6 * diagnosis.extended.holdout.rms,
               floor = 1e6 * diagnosis.baseline.noise_floor.rms;
  const char* unit = micro(diagnosis.baseline.rotary);
  const std::string noise =
      std::isfinite(floor) ? text("noise floor %.2g", floor) : std::string("noise floor not known");
  const std::size_t count = diagnosis.causes.size();
  const char* plural = count == 1 ? "" : "s";
  if (diagnosis.against_earlier && diagnosis.verdict == Verdict::kNothingSignificant)
    return text(
               "no significant change: the simulation error of the earlier model is %.3g %s RMS, "
               "it was %.3g when the model was identified (",
               before, unit, 1e6 * diagnosis.earlier_rms) +
           noise + ")";
  if (diagnosis.against_earlier && diagnosis.verdict == Verdict::kUnexplained)
    return text(
               "unexplained change: the simulation error of the earlier model is %.3g %s RMS, it "
               "was %.3g when the model was identified",
               before, unit, 1e6 * diagnosis.earlier_rms) +
           (count == 0 ? std::string()
                       : text("; %zu change%s explain%s a part of it, %.3g remain", count, plural,
                              count == 1 ? "s" : "", after)) +
           " (" + noise + ")";
  if (diagnosis.against_earlier)
    return text(
               "%zu change%s since the earlier model: its simulation error on held-out data is "
               "%.3g %s RMS, with the changes %.3g (",
               count, plural, before, unit, after) +
           noise + ")";
  switch (diagnosis.verdict) {
    case Verdict::kExplained:
      // A delay that the identified model has already, or faults of the recording that are counted.
      if (after > kMaxRmsRatioOfImprovement * before)
        return text(
                   "%zu cause%s named, part of the identified model or repaired in the recording "
                   "already: the simulation error on held-out data is %.3g %s RMS with %s (",
                   count, plural, after, unit, count == 1 ? "it" : "them") +
               noise + ")";
      return text(
                 "%zu cause%s named: the simulation error on held-out data is %.3g %s RMS instead "
                 "of %.3g (",
                 count, plural, after, unit, before) +
             noise + ")";
    case Verdict::kNothingSignificant:
      return text("nothing significant: the simulation error is %.3g %s RMS, ", before, unit) +
             noise;
    case Verdict::kUnexplained:
      if (const auto inferred = std::count_if(diagnosis.causes.begin(), diagnosis.causes.end(),
                                              [](const Cause& one) { return !one.counted(); });
          inferred > 0)
        return text(
            "unexplained: %td cause%s named, but too large a residual remains; the simulation "
            "error on held-out data is %.3g %s RMS instead of %.3g%s, %.1f times the noise floor",
            inferred, inferred == 1 ? "" : "s", after, unit, before,
            diagnosis.suspected.empty() ? "" : ", what is suspected included", after / floor);
      return text(
                 "unexplained: the simulation error is %.3g %s RMS, %.1f times the noise floor, "
                 "and no cause in the catalogue explains it",
                 before, unit, before / floor) +
             (diagnosis.suspected.empty()
                  ? ""
                  : " with enough confidence to be named; see the suspected causes");
  }
  return {};
}

}  // namespace

std::string verdict_text(const Diagnosis& diagnosis) {
  const std::string loop = verdict_of_loop(diagnosis);
  if (diagnosis.at_limit.empty()) return loop;
  return "the motor is at its torque limit. " +
         std::string(diagnosis.limit_left_out ? "Away from it " : "") + loop;
}

namespace {

std::string moved_text(const Moved& moved, bool rotary) {
  Parameter p;
  p.unit = moved.unit;
  std::string out = moved.name + text(" %.4g -> %.4g", moved.before, moved.after) +
                    (moved.unit == "1" ? "" : " " + unit_on_axis(p.unit, rotary));
  if (moved.deviation > 0.0)
    out += text(" (+-%.2g, %.0f standard deviations)", moved.deviation,
                std::abs(moved.after - moved.before) / moved.deviation);
  return out;
}

}  // namespace

bool means_something(const Effect& effect, const Parameter& shape, const Model& model) {
  constexpr double kNyquist = 0.5;  // of the sampling rate
  if (limits_motor(effect.kind) && model.loop.order != 3)
    return shape.name != "reset" && shape.name != "tracking_s";
  if (effect.kind == kind_of<Compliance>()) return effect.shape[0] * model.sample_time_s < kNyquist;
  return true;
}

std::string cause_text(const Diagnosis& diagnosis, const Cause& cause) {
  if (cause.place == kNoEffect) {
    std::string out;
    for (const Moved& moved : cause.moved)
      out += (out.empty() ? "" : ", ") + moved_text(moved, diagnosis.baseline.rotary);
    for (const auto& [name, count] : cause.counts) {
      if (count == 0.0) continue;
      const bool gap = name == "gaps";  // "1 gap", but "1 missing"
      out +=
          (out.empty() ? "" : ", ") + text("%.0f ", count) + (gap && count == 1.0 ? "gap" : name);
    }
    return out;
  }
  // One law of friction may be several causes.
  const auto named = std::find_if(diagnosis.causes.begin(), diagnosis.causes.end(),
                                  [&](const Cause& one) { return one.place == cause.place; });
  if (named != diagnosis.causes.end() && named->id != cause.id)
    return "one law with " + named->id + ", above";
  const Effect& effect = diagnosis.extended.model.effects[cause.place];
  const bool rotary = diagnosis.baseline.rotary;
  std::string out;
  const auto add = [&](const Parameter& p, double value) {
    out += (out.empty() ? "" : ", ") + std::string(p.name) + text(" %.4g", value) +
           (p.unit == "1" ? "" : " " + unit_on_axis(p.unit, rotary));
  };
  if (effect.kind == kind_of<Cogging>()) {
    const auto [first, second] = amplitudes(effect);
    return text("period %.5g %s, amplitude %.3g %s/s^2 (%.3g at half the period)",
                1e3 * effect.shape[0], milli(rotary), first, rotary ? "rad" : "m", second);
  }
  std::size_t i = 0;
  for (const Parameter& p : coefficients_of(effect.kind)) {
    if (told_from_loop(p, diagnosis.extended.model.loop.order)) add(p, effect.coefficient[i]);
    ++i;
  }
  i = 0;
  for (const Parameter& p : shapes_of(effect.kind)) {
    if (means_something(effect, p, diagnosis.extended.model)) add(p, effect.shape[i]);
    ++i;
  }
  return out;
}

std::string not_understood_text(const Diagnosis& diagnosis) {
  if (diagnosis.not_understood == kNoEffect) return {};
  const Effect& effect = diagnosis.extended.model.effects[diagnosis.not_understood];
  return std::string(identity_of(effect.kind).meaning) + " is in the extended model";
}

std::vector<std::string> left_lines(const Diagnosis& diagnosis) {
  const bool rotary = diagnosis.baseline.rotary;
  std::vector<RegressorShare> shares(diagnosis.regressors.begin(), diagnosis.regressors.end());
  constexpr double kMinBeyondChance = 0.01;  // of the variance: less helps nobody to a cause
  std::erase_if(shares, [](const RegressorShare& s) {
    return !s.significant || s.share < s.chance + kMinBeyondChance;
  });
  std::sort(shares.begin(), shares.end(),
            [](const auto& l, const auto& r) { return l.share > r.share; });
  std::string by, lines;
  for (const RegressorShare& s : shares) {
    std::string name(name_of(s.regressor));
    std::replace(name.begin(), name.end(), '_', ' ');
    if (s.regressor == Regressor::kPositionInPeriod)
      name = text("position within a period of %.4g %s", 1e3 * s.period, milli(rotary));
    by += (by.empty() ? "" : ", ") + name +
          text(" %.2g %% (by chance %.2g %%)", 100.0 * s.share, 100.0 * s.chance);
  }
  for (const SpectrumPeak& peak : diagnosis.peaks)
    lines += text("%s%.1f Hz %.2g %s", lines.empty() ? "" : ", ", peak.frequency_hz,
                  1e6 * peak.amplitude, micro(rotary));
  return {"explained by " + (by.empty() ? "no variable beyond chance" : by),
          "spectral lines: " + (lines.empty() ? "none is significant" : lines)};
}

std::string advice_for(const std::string& id, bool rises) {
  if (id == "stribeck" && rises)
    return "what rubs more the faster it moves: wipers and covers, stiff grease, preloaded "
           "bearings, a cable chain; the friction compensation of the control";
  for (std::size_t kind = 0; kind < kEffectKinds; ++kind) {
    if (identity_of(kind).cause == id) return std::string(identity_of(kind).check);
  }
  if (id == "feedforward_mismatch")
    return "the feed-forward gains in the control and the filters ahead of them";
  if (id == "dropped_samples")
    return "the load and the clock of the recording device; the connection to the encoder";
  return {};
}

bool friction_rises(const Diagnosis& diagnosis, const Cause& cause) {
  const Model& model = diagnosis.extended.model;
  if (cause.id != "stribeck" || cause.place >= model.effects.size()) return false;
  const Effect& effect = model.effects[cause.place];
  if (effect.kind == kind_of<FallingFriction>()) return effect.coefficient[0] < 0.0;
  return shape_of(model, effect.kind, "breakaway_ratio") < 1.0;
}

std::string advice_for(const Diagnosis& diagnosis, const Cause& cause) {
  const std::vector<Effect>& effects = diagnosis.extended.model.effects;
  const bool rises = friction_rises(diagnosis, cause);
  if (rises || cause.place >= effects.size()) return advice_for(cause.id, rises);
  // Of the effects that stand for a cause each has its own: play may be before or behind an
  // encoder.
  const Identity& identity = identity_of(effects[cause.place].kind);
  if (identity.cause == cause.id && !identity.check.empty()) return std::string(identity.check);
  return advice_for(cause.id);
}

std::string cause_page(const std::string& id) { return "docs/causes/" + id + ".md"; }

std::string page_to_read(const std::string& id) {
  std::error_code absent;
  const auto program = std::filesystem::read_symlink("/proc/self/exe", absent);
  const auto installed =
      program.parent_path().parent_path() / "share/doc/servotwin" / cause_page(id);
  return std::filesystem::exists(installed, absent) ? installed.string() : cause_page(id);
}

}  // namespace servotwin
