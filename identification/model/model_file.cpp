#include "identification/model/model_file.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <stdexcept>

#include "identification/model/json_number.h"
#include "twin/twin.h"
#include "twin/two_pi.h"

namespace servotwin {

using nlohmann::json;

namespace {

// Beyond everything that a store or a recording reaches; with room to count on.
constexpr int kMaxVersion = 1'000'000'000;
constexpr long kMaxRows = 1'000'000'000'000'000;
constexpr double kMaxError = 1e6;   // m | rad
constexpr double kMaxMotion = 1e6;  // m/s, m/s^2 | rad/s, rad/s^2
constexpr double kMaxTorque = 1e12;
constexpr double kMaxTorqueLag_s = 1.0;
constexpr double kMaxCovariance = 1e60;
constexpr double kMaxTime_s = 1e12;  // a stamp may count from 1970

[[noreturn]] void refuse(const std::string& field, const std::string& why) {
  throw std::runtime_error("model file: " + field + ": " + why);
}

const json& member(const json& object, const std::string& path, const char* key) {
  if (!object.is_object()) refuse(path, "must be an object");
  const auto found = object.find(key);
  const std::string field = path.empty() ? key : path + "." + key;
  if (found == object.end()) refuse(field, "is missing");
  return *found;
}

std::string field_of(const std::string& path, const char* key) {
  return path.empty() ? key : path + "." + key;
}

double finite(const json& object, const std::string& path, const char* key) {
  const json& value = member(object, path, key);
  if (!value.is_number()) refuse(field_of(path, key), "must be a number, is " + value.dump());
  return value.get<double>();
}

double position(const json& object, const std::string& path, const char* key) {
  constexpr double kMaxPosition = 1e6;  // m | rad
  const double value = finite(object, path, key);
  if (!(std::abs(value) <= kMaxPosition))
    refuse(field_of(path, key), "must lie within +-1e+06, is " + object[key].dump());
  return value;
}

/// A value in another unit must not be read as one in ours. Programs before version 0.2.0 wrote rad
/// for a rotary axis only in units that begin with "m/", and left m in the others (m, s/m, 1/m^2):
/// such files are read as well.
void require_unit(const json& object, const std::string& path, const Parameter& parameter,
                  bool rotary) {
  const std::string unit = unit_on_axis(parameter.unit, rotary);
  const std::string before =
      parameter.unit.substr(0, 2) == "m/" ? unit : std::string(parameter.unit);
  if (const auto found = object.find("unit");
      found != object.end() && *found != unit && *found != before) {
    refuse(path + ".unit", "must be \"" + unit + "\", is " + found->dump());
  }
}

double optional(const json& object, const char* key) {
  const auto found = object.is_object() ? object.find(key) : object.end();
  return object.is_object() && found != object.end() && found->is_number() ? found->get<double>()
                                                                           : kAbsent;
}

/// A whole number from 0 to `most`; 0 if it is missing or null.
template <class Integer>
Integer count(const json& object, const std::string& path, const char* key, Integer most) {
  const double value = optional(object, key);
  if (std::isnan(value)) return 0;
  if (!(value >= 0.0 && value <= static_cast<double>(most) && value == std::floor(value)))
    refuse(field_of(path, key), "must be a whole number from 0 to " + std::to_string(most) +
                                    ", is " + object[key].dump());
  return static_cast<Integer>(value);
}

std::string text(const json& object, const std::string& path, const char* key) {
  const json& value = member(object, path, key);
  if (!value.is_string()) refuse(field_of(path, key), "must be a string, is " + value.dump());
  return value.get<std::string>();
}

std::array<double, kMaxOrder> coefficients(const json& object, const std::string& path,
                                           const char* key, int order) {
  const json& list = member(object, path, key);
  const std::string field = field_of(path, key);
  if (!list.is_array() || list.size() != static_cast<std::size_t>(order)) {
    refuse(field, "must be a list of " + std::to_string(order) + " numbers, is " + list.dump());
  }
  std::array<double, kMaxOrder> out{};
  for (std::size_t i = 0; i < list.size(); ++i) {
    if (!list[i].is_number())
      refuse(field + "[" + std::to_string(i) + "]", "must be a number, is " + list[i].dump());
    out[i] = list[i].get<double>();
  }
  return out;
}

json deviations(const std::array<double, kMaxOrder>& sd, int order) {
  json out = json::array();
  for (int i = 0; i < order; ++i) out.push_back(number_or_null(sd[static_cast<std::size_t>(i)]));
  return out;
}

/// Of the values that a loop of this order has: the poles as they are named, c0.., the delay.
std::vector<int> covariance_rows(int order) {
  std::vector<int> out;
  for (int i = 0; i < kLoopValues; ++i) {
    if (order == 3 || (i != 0 && i != 3 + 2)) out.push_back(i);
  }
  return out;
}

json covariance_json(const ModelRecord& record) {
  if (!record.loop_covariance) return nullptr;
  const std::vector<int> rows = covariance_rows(record.model.loop.order);
  json out = json::array();
  for (const int i : rows) {
    json row = json::array();
    for (const int k : rows) row.push_back(number_or_null((*record.loop_covariance)(i, k)));
    out.push_back(std::move(row));
  }
  return out;
}

std::optional<LoopCovariance> covariance_from(const json& loop, int order) {
  const auto found = loop.find("covariance");
  if (found == loop.end() || found->is_null()) return std::nullopt;
  constexpr const char* kField = "loop.covariance";
  const std::vector<int> rows = covariance_rows(order);
  const std::size_t n = rows.size();
  const std::string size = std::to_string(n);
  LoopCovariance out = LoopCovariance::Zero();
  if (!found->is_array() || found->size() != n)
    refuse(kField, "must be a list of " + size + " rows, is " + found->dump());
  for (std::size_t i = 0; i < n; ++i) {
    const json& row = (*found)[i];
    const std::string field = kField + ("[" + std::to_string(i) + "]");
    if (!row.is_array() || row.size() != n)
      refuse(field, "must be a list of " + size + " numbers, is " + row.dump());
    for (std::size_t k = 0; k < n; ++k) {
      if (!row[k].is_number()) refuse(field, "must hold numbers, holds " + row[k].dump());
      if (!(std::abs(row[k].get<double>()) <= kMaxCovariance))
        refuse(field, "must hold numbers within +-1e+60, holds " + row[k].dump());
      out(rows[i], rows[k]) = row[k].get<double>();
    }
  }
  if (out != out.transpose()) refuse(kField, "must be symmetric, is " + found->dump());
  if (!(out.diagonal().minCoeff() >= 0.0))
    refuse(kField, "must have no negative variance on its diagonal, is " + found->dump());
  return out;
}

json torque_json(const MotorTorque& torque) {
  return {{"unit", torque.unit},
          {"per_acceleration", torque.by.scale},
          {"per_velocity", torque.by.viscous},
          {"offset", torque.by.offset},
          {"lag_s", torque.lag.s},
          {"lag_is_filter", torque.lag.filter},
          {"fitted_together", torque.fitted_together},
          {"at_limit_share", torque.at_limit_share},
          {"training_rms", number_or_null(torque.training_rms)},
          {"holdout_rms", number_or_null(torque.holdout_rms)},
          {"holdout_scatter", number_or_null(torque.holdout_scatter)}};
}

/// Nothing where the file has none.
std::optional<MotorTorque> torque_from(const json& file) {
  const auto found = file.find("torque");
  if (found == file.end() || found->is_null()) return std::nullopt;
  if (!found->is_object()) refuse("torque", "must be an object, is " + found->dump());
  MotorTorque out;
  out.unit = text(*found, "torque", "unit");
  constexpr std::array<std::string_view, 5> kUnits{"N", "Nm", "A", "V", "%"};
  if (std::find(kUnits.begin(), kUnits.end(), out.unit) == kUnits.end())
    refuse("torque.unit", "must be N, Nm, A, V or %, is \"" + out.unit + "\"");
  const auto value = [&](const char* key) {
    const double x = finite(*found, "torque", key);
    if (!(std::abs(x) <= kMaxTorque))
      refuse(field_of("torque", key), "must lie within +-1e+12, is " + (*found)[key].dump());
    return x;
  };
  out.by = {value("per_acceleration"), value("per_velocity"), value("offset")};
  out.lag.s = value("lag_s");
  if (!(std::abs(out.lag.s) <= kMaxTorqueLag_s))
    refuse("torque.lag_s", "must lie within +-1 s, is " + (*found)["lag_s"].dump());
  const auto is_set = [&](const char* key) {
    const auto flag = found->find(key);
    if (flag == found->end()) return false;
    if (!flag->is_boolean())
      refuse(field_of("torque", key), "must be true or false, is " + flag->dump());
    return flag->get<bool>();
  };
  out.lag.filter = is_set("lag_is_filter");
  if (out.lag.filter && !(out.lag.s >= 0.0))
    refuse("torque.lag_s", "of a filter must not be negative, is " + (*found)["lag_s"].dump());
  out.fitted_together = is_set("fitted_together");
  if (const double share = optional(*found, "at_limit_share"); std::isfinite(share))
    out.at_limit_share = share;
  out.training_rms = optional(*found, "training_rms");
  out.holdout_rms = optional(*found, "holdout_rms");
  out.holdout_scatter = optional(*found, "holdout_scatter");
  return out;
}

json figures(const ErrorFigures& f) {
  json out = {{"rms_m", number_or_null(f.rms)}, {"max_m", number_or_null(f.max)}};
  if (std::isfinite(f.motor_rms)) out["motor_rms_m"] = f.motor_rms;
  return out;
}

ErrorFigures figures_from(const json& fit, const char* key) {
  const auto found = fit.is_object() ? fit.find(key) : fit.end();
  if (!fit.is_object() || found == fit.end()) return {};
  const auto figure = [&](const char* name) {
    const double value = optional(*found, name);
    if (value < 0.0 || value > kMaxError)
      refuse("fit." + std::string(key) + "." + name,
             "must lie between 0 and 1e+06, is " + (*found)[name].dump());
    return value;
  };
  return {figure("rms_m"), figure("max_m"), figure("motor_rms_m")};
}

/// The values of a mode in the file, and how to get at them.
struct ModeValue {
  const char* name;
  double Mode::*value;
};
constexpr ModeValue kModeValues[] = {
    {"natural_frequency_rad_s", &Mode::omega},
    {"damping_ratio", &Mode::zeta},
    {"alpha", &Mode::alpha},
    {"beta_per_s", &Mode::beta},
    {"gamma_s", &Mode::gamma},
    {"delta", &Mode::delta},
};
/// Of one that moves, over loop.travel.
constexpr ModeValue kMovingValues[] = {
    {"log_frequency_slope", &Mode::slope},
    {"log_frequency_curve", &Mode::curve},
    {"log_damping_slope", &Mode::zeta_slope},
};

json modes_json(const ModelRecord& record) {
  json out = json::array();
  for (std::size_t i = 0; i < record.model.loop.modes.size(); ++i) {
    json mode;
    const auto put = [&](const ModeValue& v) {
      mode[v.name] = record.model.loop.modes[i].*v.value;
      if (i < record.mode_deviations.size())
        mode[std::string(v.name) + "_sd"] = number_or_null(record.mode_deviations[i].*v.value);
    };
    for (const ModeValue& v : kModeValues) put(v);
    for (const ModeValue& v : kMovingValues) {
      if (record.model.loop.modes[i].moves()) put(v);
    }
    mode["natural_frequency_hz"] = record.model.loop.modes[i].omega / kTwoPi;  // for people
    out.push_back(mode);
  }
  return out;
}

void read_modes(const json& loop, ModelRecord& record) {
  if (const auto travel = loop.find("travel"); travel != loop.end())
    record.model.loop.travel = {position(*travel, "loop.travel", "from_m"),
                                position(*travel, "loop.travel", "to_m")};
  const auto found = loop.find("modes");
  if (found == loop.end()) return;
  if (!found->is_array()) refuse("loop.modes", "must be a list");
  for (std::size_t i = 0; i < found->size(); ++i) {
    const std::string path = "loop.modes[" + std::to_string(i) + "]";
    Mode mode, deviation;
    const auto take = [&](const ModeValue& v) {
      mode.*v.value = finite((*found)[i], path, v.name);
      deviation.*v.value = optional((*found)[i], (std::string(v.name) + "_sd").c_str());
    };
    for (const ModeValue& v : kModeValues) take(v);
    for (const ModeValue& v : kMovingValues) {
      if ((*found)[i].contains(v.name)) take(v);
    }
    record.model.loop.modes.push_back(mode);
    record.mode_deviations.push_back(deviation);
  }
}

json loop_json(const ModelRecord& record) {
  const Loop& loop = record.model.loop;
  json poles = json::array();
  const auto roots = roots_of(loop);
  for (int i = 0; i < loop.order; ++i) {
    const auto& root = roots[static_cast<std::size_t>(i)];
    poles.push_back({root.real(), root.imag()});
  }
  json numerator = json::array(), denominator = json::array();
  for (int i = 0; i < loop.order; ++i) {
    numerator.push_back(loop.numerator[static_cast<std::size_t>(i)]);
    denominator.push_back(loop.denominator[static_cast<std::size_t>(i)]);
  }
  const PoleSet named = labels_of(loop).set[0];
  json out{{"order", loop.order},
           {"poles", poles},  // [re, im] in rad/s, of the denominator
           {"denominator", denominator},
           {"tracking_error_numerator", numerator},
           {"natural_frequency_hz", named.omega / kTwoPi},
           {"damping_ratio", named.zeta},
           {"natural_frequency_sd_hz", number_or_null(record.pole_deviation.omega / kTwoPi)},
           {"damping_ratio_sd", number_or_null(record.pole_deviation.zeta)},
           {"denominator_sd", deviations(record.denominator_deviation, loop.order)},
           {"tracking_error_numerator_sd", deviations(record.numerator_deviation, loop.order)},
           {"covariance", covariance_json(record)}};
  if (loop.order == 3) {
    out["real_pole_hz"] = named.real / kTwoPi;
    out["real_pole_sd_hz"] = number_or_null(record.pole_deviation.real / kTwoPi);
  }
  if (!loop.modes.empty()) out["modes"] = modes_json(record);
  if (std::any_of(loop.modes.begin(), loop.modes.end(), [](const Mode& m) { return m.moves(); }))
    out["travel"] = {{"from_m", loop.travel.from}, {"to_m", loop.travel.to}};
  // The gain of the unit friction of the rigid-body model, for readers that know no effects.
  const Effect* friction = record.model.find(kind_of<CoulombFriction>());
  out["disturbance_gain"] = friction != nullptr ? friction->coefficient[0] : 0.0;
  return out;
}

}  // namespace

json to_json(const ModelRecord& record) {
  json effects = json::array();
  for (std::size_t i = 0; i < record.model.effects.size(); ++i) {
    const Effect& effect = record.model.effects[i];
    const EffectDeviations sd =
        i < record.effect_deviations.size() ? record.effect_deviations[i] : EffectDeviations{};
    json parameters = json::object();
    std::size_t k = 0;
    for (const Parameter& p : shapes_of(effect.kind)) {
      parameters[std::string(p.name)] = {{"value", effect.shape[k]},
                                         {"unit", unit_on_axis(p.unit, record.rotary)},
                                         {"sd", number_or_null(sd.shape[k])}};
      ++k;
    }
    k = 0;
    for (const Parameter& p : coefficients_of(effect.kind)) {
      parameters[std::string(p.name)] = {{"value", effect.coefficient[k]},
                                         {"unit", unit_on_axis(p.unit, record.rotary)},
                                         {"sd", number_or_null(sd.coefficient[k])}};
      ++k;
    }
    effects.push_back({{"id", identity_of(effect.kind).id}, {"parameters", parameters}});
    if (couples(effect.kind) && !record.neighbour.empty())
      effects.back()["of_axis"] = record.neighbour;
  }
  json out = {{"schema", kModelSchema},
              {"axis", record.axis},
              {"kind", record.rotary ? "rotary" : "linear"},
              {"version", record.version},
              {"created", record.created},
              {"parent", record.parent},
              {"sample_time_s", record.model.sample_time_s},
              {"loop", loop_json(record)},
              {"effects", effects},
              {"fit",
               {{"method", record.method},
                {"training", figures(record.training)},
                {"holdout", figures(record.holdout)},
                {"noise_floor_rms_m", number_or_null(record.noise_floor.rms)},
                {"noise_floor_interval_m", interval_or_null(record.noise_floor)},
                {"condition_number", number_or_null(record.condition_number)},
                {"time_taken_s", number_or_null(record.time_taken_s)}}},
              {"data",
               {{"source", record.source},
                {"from", record.from_s},
                {"to", record.to_s},
                {"training_to", record.training_to_s},
                {"rows", record.rows},
                {"motion",
                 {{"speed_m_per_s", number_or_null(record.motion.speed)},
                  {"acceleration_m_per_s2", number_or_null(record.motion.acceleration)}}},
                {"excitation",
                 {{"sufficient", record.excitation.empty()}, {"missing", record.excitation}}}}}};
  if (record.torque) out["torque"] = torque_json(*record.torque);
  return out;
}

ModelRecord model_from_json(const json& j) {
  if (!j.is_object()) refuse("schema", "the file is no JSON object");
  const std::string schema = text(j, "", "schema");
  if (schema != kModelSchema)
    refuse("schema", "is \"" + schema + "\", must be \"" + std::string(kModelSchema) + "\"");
  ModelRecord record;
  record.axis = text(j, "", "axis");
  if (record.axis.empty()) refuse("axis", "must not be empty");
  const auto kind = j.value("kind", json("linear"));
  if (kind != "linear" && kind != "rotary")
    refuse("kind", "must be \"linear\" or \"rotary\", is " + kind.dump());
  record.rotary = kind == "rotary";
  record.version = count(j, "", "version", kMaxVersion);
  record.parent = count(j, "", "parent", kMaxVersion);
  if (j.contains("created") && j["created"].is_string())
    record.created = j["created"].get<std::string>();
  Model& model = record.model;
  model.sample_time_s = finite(j, "", "sample_time_s");

  const json& loop = member(j, "", "loop");
  const json& order = member(loop, "loop", "order");
  if (!order.is_number_integer() || (order != 2 && order != 3))
    refuse("loop.order", "must be 2 or 3, is " + order.dump());
  model.loop.order = order.get<int>();
  model.loop.denominator = coefficients(loop, "loop", "denominator", model.loop.order);
  model.loop.numerator = coefficients(loop, "loop", "tracking_error_numerator", model.loop.order);
  read_modes(loop, record);

  const json& effects = member(j, "", "effects");
  if (!effects.is_array()) refuse("effects", "must be a list");
  for (std::size_t i = 0; i < effects.size(); ++i) {
    const std::string path = "effects[" + std::to_string(i) + "]";
    const std::string id = text(effects[i], path, "id");
    Effect effect;
    effect.kind = kind_of(id);
    if (effect.kind == kEffectKinds)
      refuse(path + ".id", "\"" + id + "\" is not an effect of the catalogue");
    const json& parameters = member(effects[i], path, "parameters");
    EffectDeviations sd;
    const auto read = [&](std::span<const Parameter> list, auto& values, auto& deviation) {
      std::size_t k = 0;
      for (const Parameter& p : list) {
        const std::string name(p.name);
        const json& entry = member(parameters, path + ".parameters", name.c_str());
        values[k] = finite(entry, path + ".parameters." + name, "value");
        require_unit(entry, path + ".parameters." + name, p, record.rotary);
        deviation[k] = optional(entry, "sd");
        ++k;
      }
    };
    read(shapes_of(effect.kind), effect.shape, sd.shape);
    read(coefficients_of(effect.kind), effect.coefficient, sd.coefficient);
    for (const auto& [name, value] : parameters.items()) {
      const auto known = [&name = name](std::span<const Parameter> list) {
        return std::any_of(list.begin(), list.end(),
                           [&](const Parameter& p) { return p.name == name; });
      };
      if (!known(shapes_of(effect.kind)) && !known(coefficients_of(effect.kind))) {
        refuse(path + ".parameters." + name, "is not a parameter of " + id);
      }
    }
    model.effects.push_back(effect);
    record.effect_deviations.push_back(sd);
    if (couples(effect.kind) && effects[i].contains("of_axis"))
      record.neighbour = text(effects[i], path, "of_axis");
  }
  if (auto why = why_invalid(model, record.rotary ? kLargestLengthScale : 1.0); !why.empty())
    throw std::runtime_error("model file: " + why);

  // What the file says twice must agree, or a hand has changed one of the two.
  const json expected = loop_json(record);
  const auto same = [&](const char* key) {
    const auto found = loop.find(key);
    if (found == loop.end()) return;
    const json& want = expected[key];
    const auto close = [](const json& l, const json& r) {
      if (!l.is_number() || !r.is_number()) return false;
      const double a = l.get<double>(), b = r.get<double>();
      return std::abs(a - b) <= 1e-6 * std::max({1.0, std::abs(a), std::abs(b)});
    };
    bool agree =
        found->is_array() == want.is_array() && (!want.is_array() || found->size() == want.size());
    for (std::size_t i = 0; agree && want.is_array() && i < want.size(); ++i) {
      agree = (*found)[i].is_array() && (*found)[i].size() == 2 &&
              close((*found)[i][0], want[i][0]) && close((*found)[i][1], want[i][1]);
    }
    if (agree && !want.is_array()) agree = close(*found, want);
    if (!agree)
      refuse(std::string("loop.") + key,
             "contradicts the rest of the file; " + want.dump() + " would agree");
  };
  for (const char* key : {"poles", "natural_frequency_hz", "damping_ratio", "real_pole_hz"})
    same(key);
  same("disturbance_gain");

  const auto deviation_list = [&](const char* key) {
    std::array<double, kMaxOrder> out;
    out.fill(kAbsent);
    if (const auto found = loop.find(key); found != loop.end() && found->is_array()) {
      for (std::size_t i = 0; i < std::min<std::size_t>(found->size(), out.size()); ++i) {
        if ((*found)[i].is_number()) out[i] = (*found)[i].get<double>();
      }
    }
    return out;
  };
  record.denominator_deviation = deviation_list("denominator_sd");
  record.numerator_deviation = deviation_list("tracking_error_numerator_sd");
  record.pole_deviation = {optional(loop, "real_pole_sd_hz") * kTwoPi,
                           optional(loop, "natural_frequency_sd_hz") * kTwoPi,
                           optional(loop, "damping_ratio_sd")};
  record.loop_covariance = covariance_from(loop, model.loop.order);
  record.torque = torque_from(j);
  const json fit = j.value("fit", json::object());
  record.training = figures_from(fit, "training");
  record.holdout = figures_from(fit, "holdout");
  record.noise_floor.rms = optional(fit, "noise_floor_rms_m");
  if (const json interval = fit.value("noise_floor_interval_m", json());
      interval.is_array() && interval.size() == 2 && interval[0].is_number() &&
      interval[1].is_number()) {
    record.noise_floor.low = interval[0].get<double>();
    record.noise_floor.high = interval[1].get<double>();
  }
  record.condition_number = optional(fit, "condition_number");
  record.time_taken_s = optional(fit, "time_taken_s");
  if (fit.contains("method") && fit["method"].is_string())
    record.method = fit["method"].get<std::string>();
  const json data = j.value("data", json::object());
  const auto time = [&](const char* key) {
    const double value = optional(data, key);
    if (std::abs(value) > kMaxTime_s)
      refuse(field_of("data", key), "must be a time of up to +-1e+12 s, is " + data[key].dump());
    return std::isfinite(value) ? value : 0.0;
  };
  if (data.contains("source") && data["source"].is_string())
    record.source = data["source"].get<std::string>();
  record.from_s = time("from");
  record.to_s = time("to");
  record.training_to_s = time("training_to");
  record.rows = count(data, "data", "rows", kMaxRows);
  if (const auto motion = data.find("motion"); motion != data.end()) {
    const auto known = [&](const char* key) {
      const double value = optional(*motion, key);
      if (value < 0.0)
        refuse(std::string("data.motion.") + key, "must not be negative, is " + motion->dump());
      if (value > kMaxMotion)
        refuse(std::string("data.motion.") + key, "must be at most 1e+06, is " + motion->dump());
      return value;
    };
    record.motion = {known("speed_m_per_s"), known("acceleration_m_per_s2")};
  }
  if (data.contains("excitation") && data["excitation"].is_object()) {
    for (const json& line : data["excitation"].value("missing", json::array())) {
      if (line.is_string()) record.excitation.push_back(line.get<std::string>());
    }
  }
  return record;
}

ModelRecord read_model(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  if (!in) throw std::runtime_error(path.string() + ": cannot be opened: " + std::strerror(errno));
  std::ostringstream content;
  content << in.rdbuf();
  json j;
  try {
    j = json::parse(content.str());
  } catch (const json::parse_error& error) {
    throw std::runtime_error(
        path.string() + ": model file: is no complete JSON document (error at byte " +
        std::to_string(error.byte) + " of " + std::to_string(content.str().size()) +
        "); servotwin identify REC --model FILE writes one");
  } catch (const json::exception& error) {  // a number beyond all bounds
    throw std::runtime_error(path.string() + ": model file: " + error.what());
  }
  try {
    return model_from_json(j);
  } catch (const std::runtime_error& error) {
    throw std::runtime_error(path.string() + ": " + error.what());
  } catch (const json::exception& error) {  // a field of another type where no rule names it
    throw std::runtime_error(path.string() + ": model file: " + error.what());
  }
}

}  // namespace servotwin
