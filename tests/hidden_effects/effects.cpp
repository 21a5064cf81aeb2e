#include "tests/hidden_effects/effects.h"

#include <algorithm>
#include <set>
#include <stdexcept>

#include "tests/hidden_effects/put_in.h"

namespace servotwin::hidden_effects {
namespace {

struct Entry {
  Needs needs;
  Hidden (*make)(const Scene&, Random&);
};

const std::map<std::string, Entry, std::less<>>& entries() {
  static const std::map<std::string, Entry, std::less<>> all{
      {"stribeck", {{.level_friction = true}, put_in::stribeck}},
      {"presliding", {{.coulomb = true}, put_in::presliding}},
      {"asymmetric_friction", {{}, put_in::asymmetric_friction}},
      {"position_dependent_friction", {{}, put_in::position_dependent_friction}},
      {"added_friction", {{}, put_in::added_friction}},
      {"backlash", {{.motor_loop = true}, put_in::backlash}},
      {"compliance", {{}, put_in::compliance}},
      {"cogging", {{}, put_in::cogging}},
      {"lead_error", {{.outside = true}, put_in::lead_error}},
      {"encoder_error", {{.inside = true}, put_in::encoder_error}},
      {"gravity_offset", {{.no_integrator = true}, put_in::gravity_offset}},
      {"inertia_change", {{}, put_in::inertia_change}},
      {"viscous_drift", {{}, put_in::viscous_drift}},
      {"time_delay", {{}, put_in::time_delay}},
      {"gain_change", {{}, put_in::gain_change}},
      {"torque_saturation", {{}, put_in::torque_saturation}},
      {"periodic_disturbance", {{}, put_in::periodic_disturbance}},
      {"impulse_disturbance", {{}, put_in::impulse_disturbance}},
      {"cutting_force", {{}, put_in::cutting_force}},
      {"cross_coupling", {{.other_axis = true}, put_in::cross_coupling}},
      {"dwell_stiction", {{.long_rests = true}, put_in::dwell_stiction}},
      {"thermal_growth", {{.outside = true}, put_in::thermal_growth}},
      {"dropped_samples", {{}, put_in::dropped_samples}}};
  return all;
}

const Entry& entry_of(std::string_view id) {
  const auto found = entries().find(id);
  if (found == entries().end()) {
    throw std::invalid_argument("hidden effects: there is no effect '" + std::string(id) + "'");
  }
  return found->second;
}

}  // namespace

const std::vector<std::string>& effect_ids() {
  static const std::vector<std::string> ids = [] {
    std::vector<std::string> out;
    for (const auto& [id, entry] : entries()) out.push_back(id);
    return out;
  }();
  return ids;
}

const std::vector<std::string>& blind_ids() {
  static const std::vector<std::string> ids{"gravity_offset", "lead_error", "thermal_growth"};
  return ids;
}

bool may_pair(std::string_view a, std::string_view b) {
  // Backlash and compliance share one spring. In one attitude an asymmetry is a constant force plus
  // a change of friction. Slow thermal growth and a slope of the screw are the same line for most
  // of the record.
  static const std::set<std::pair<std::string_view, std::string_view>> never{
      {"backlash", "compliance"},
      {"asymmetric_friction", "gravity_offset"},
      {"lead_error", "thermal_growth"},
      {"added_friction", "viscous_drift"}};
  return a != b && !never.contains({std::min(a, b), std::max(a, b)});
}

Needs Needs::with(const Needs& o) const {
  return {coulomb || o.coulomb,       level_friction || o.level_friction,
          outside || o.outside,       inside || o.inside,
          motor_loop || o.motor_loop, no_integrator || o.no_integrator,
          integrator || o.integrator, other_axis || o.other_axis,
          long_rests || o.long_rests};
}

Needs needs_of(std::string_view id, bool blind) {
  Needs needs = entry_of(id).needs;
  if (!blind) return needs;
  // The motor's encoder does not measure screw and table; an integrator holds a load without error.
  if (needs.outside) return {.inside = true, .motor_loop = true};
  return {.integrator = true};
}

Hidden hide(std::string_view id, const Scene& scene, Random& random) {
  return entry_of(id).make(scene, random);
}

}  // namespace servotwin::hidden_effects
