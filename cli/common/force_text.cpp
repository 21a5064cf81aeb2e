#include "cli/common/force_text.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include "cli/common/output.h"
#include "identification/loop/joint.h"
#include "twin/effect.h"

namespace servotwin::cli {

std::string ForceUnit::of(std::string_view per_mass) const {
  if (per_mass == "m/s^2") return name;
  if (per_mass == "1/s") return name + (rotary ? " s/rad" : " s/m");
  return std::string(per_mass);
}

std::string ForceUnit::of_shape(std::string_view unit) const { return unit_on_axis(unit, rotary); }

std::string ForceUnit::of_mass() const {
  if (!rotary && name == "N") return "kg";
  if (rotary && name == "Nm") return "kg m^2";
  return name + (rotary ? " per rad/s^2" : " per m/s^2");
}

ForceUnit force_unit(const std::string& torque_unit, bool rotary, double lead) {
  if (lead > 0.0) return {"N", lead / (2.0 * std::numbers::pi), rotary};
  return {torque_unit, 1.0, rotary};
}

namespace {

/// "offset_mps2" is the name of a force per moved mass; here it is "offset_n".
std::string name_of(const Parameter& parameter, const ForceUnit& unit) {
  constexpr std::string_view kPerMass = "_mps2";
  std::string name(parameter.name);
  if (!name.ends_with(kPerMass)) return name;
  name.resize(name.size() - kPerMass.size() + 1);
  for (const char c : unit.name == "%" ? "percent" : unit.name)
    name += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
  return name;
}

}  // namespace

void require_torque(SegmentedAxis& axis, bool inverted) {
  if (axis.torque_unit.empty()) {
    throw std::runtime_error(axis.source + ": axis " + axis.axis + " has no torque; add a column " +
                             axis.axis +
                             ".torque[Nm|N|A|V|%] with the motor's torque, force or current");
  }
  double low = 1e300, high = -1e300;
  for (Segment& s : axis.segments) {
    if (inverted) s.torque = -s.torque;
    for (const double value : s.torque) {
      if (!std::isfinite(value)) continue;
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  if (!(low < high)) {
    throw std::runtime_error(axis.source + ": " + axis.axis +
                             ".torque never changes; is it the motor's torque?");
  }
}

void require_resisting(const std::vector<Ramp>& ramps, const std::string& source) {
  const auto against = std::count_if(ramps.begin(), ramps.end(), [](const Ramp& ramp) {
    return ramp.torque * ramp.velocity < 0.0;
  });
  if (2 * against <= static_cast<std::ptrdiff_t>(ramps.size())) return;
  throw std::runtime_error(source + ": on " + std::to_string(against) + " of " +
                           std::to_string(ramps.size()) +
                           " ramps the torque acts against the motion that it should drive: its "
                           "sign is inverted; add --invert-torque");
}

void require_mass(const ForceFit& fit, const std::string& source) {
  if (fit.model.mass > 0.0) return;
  throw std::runtime_error(
      source +
      ": torque and acceleration do not match (the moved mass would be 0 or less); if the drive "
      "records torque with the opposite sign, add --invert-torque");
}

std::vector<std::string> force_lines(const ForceFit& fit, bool with_mass, const ForceUnit& unit) {
  const auto value = [](double v, double sd, const std::string& of) {
    std::string out = text("%.4g", v);
    if (std::isfinite(sd) && sd > 0.0) out += text(" +- %.2g", sd);
    return out + (of == "1" ? "" : " " + of);
  };
  std::vector<std::string> lines;
  if (with_mass) {
    lines.push_back("moved mass  " + value(fit.model.mass / unit.scale,
                                           fit.mass_deviation / unit.scale, unit.of_mass()));
  }
  for (std::size_t i = 0; i < fit.model.effects.size(); ++i) {
    const Effect& effect = fit.model.effects[i];
    std::string line = "effect      " + std::string(identity_of(effect.kind).id) + "  ";
    std::size_t k = 0;
    for (const Parameter& p : coefficients_of(effect.kind)) {
      line += (k == 0 ? "" : ", ") + name_of(p, unit) + " " +
              value(effect.coefficient[k] / unit.scale,
                    fit.deviations[i].coefficient[k] / unit.scale, unit.of(p.unit));
      ++k;
    }
    k = 0;
    for (const Parameter& p : shapes_of(effect.kind)) {
      line += ", " + name_of(p, unit) + " " +
              value(effect.shape[k], fit.deviations[i].shape[k], unit.of_shape(p.unit));
      ++k;
    }
    lines.push_back(std::move(line));
  }
  return lines;
}

nlohmann::json force_json(const ForceFit& fit, bool with_mass, const ForceUnit& unit) {
  using nlohmann::json;
  json out;
  if (with_mass) {
    out["mass"] = {{"value", fit.model.mass / unit.scale},
                   {"unit", unit.of_mass()},
                   {"sd", fit.mass_deviation / unit.scale}};
  }
  json effects = json::array();
  for (std::size_t i = 0; i < fit.model.effects.size(); ++i) {
    const Effect& effect = fit.model.effects[i];
    json parameters = json::object();
    std::size_t k = 0;
    for (const Parameter& p : coefficients_of(effect.kind)) {
      parameters[name_of(p, unit)] = {{"value", effect.coefficient[k] / unit.scale},
                                      {"unit", unit.of(p.unit)},
                                      {"sd", fit.deviations[i].coefficient[k] / unit.scale}};
      ++k;
    }
    k = 0;
    for (const Parameter& p : shapes_of(effect.kind)) {
      parameters[name_of(p, unit)] = {{"value", effect.shape[k]},
                                      {"unit", unit.of_shape(p.unit)},
                                      {"sd", fit.deviations[i].shape[k]}};
      ++k;
    }
    effects.push_back({{"id", identity_of(effect.kind).id}, {"parameters", parameters}});
  }
  out["effects"] = effects;
  return out;
}

std::vector<std::string> undetermined(const ForceFit& fit) {
  std::vector<std::string> names;
  for (std::size_t i = 0; i < fit.model.effects.size(); ++i) {
    const Effect& effect = fit.model.effects[i];
    const auto look = [&](const auto& parameters, const auto& values, const auto& deviations) {
      std::size_t k = 0;
      for (const Parameter& p : parameters) {
        // A value of 0 is a result; an unknown deviation (NaN) means not determined.
        if (values[k] != 0.0 && !(deviations[k] <= std::abs(values[k]))) names.emplace_back(p.name);
        ++k;
      }
    };
    look(coefficients_of(effect.kind), effect.coefficient, fit.deviations[i].coefficient);
    look(shapes_of(effect.kind), effect.shape, fit.deviations[i].shape);
  }
  return names;
}

std::vector<std::string> torque_frictions() {
  std::vector<std::string> ids;
  for (const std::size_t kind : friction_kinds()) ids.emplace_back(identity_of(kind).id);
  ids.emplace_back(identity_of(kind_of<FrictionMap>()).id);
  return ids;
}

}  // namespace servotwin::cli
