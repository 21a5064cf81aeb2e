#include "cli/recording/feed_axis_file.h"

#include <algorithm>
#include <charconv>
#include <sstream>
#include <stdexcept>

#include "drivers/common/file_handle.h"
#include "drivers/common/text.h"
#include "drivers/common/toml_section.h"
#include "twin/shown_units.h"

namespace servotwin {
namespace {

constexpr double kPerMicrometre = 1e6;      // N/um
constexpr double kSquareCentimetre = 1e-4;  // of an inertia
constexpr double kGiga = 1e9;

/// A table of the file, whose numbers are in the units of their keys.
class Part {
 public:
  Part(Section section) : section_(std::move(section)) {}

  /// Reads an optional key; without it, `to` keeps its value.
  void may(const std::string& key, double lower, double upper, const std::string& unit,
           double scale, double& to) {
    double value = to / scale;
    section_.number(key, lower, upper, unit, value);
    if (section_.has(key)) to = value * scale;
  }
  void must(const std::string& key, double lower, double upper, const std::string& unit,
            double scale, double& to) {
    if (section_.given() && !section_.has(key)) section_.report_missing(key, "is missing");
    may(key, lower, upper, unit, scale, to);
  }
  Section* operator->() { return &section_; }

 private:
  Section section_;
};

Part required(Section& root, const std::string& name) {
  if (!root.has(name)) root.report_missing("[" + name + "]", "is missing");
  return {root.section(name)};
}

void read_material(Part& screw, const std::string& kind, MaterialDamping& damping) {
  screw.may(kind + "_mass_damping_per_s", 0.0, 1e5, "1/s", 1.0, damping.mass);
  screw.may(kind + "_stiffness_damping_us", 0.0, 1e4, "us", kMicro, damping.stiffness);
}

void read_screw(Part screw, ScrewParts& to) {
  screw.must("diameter_mm", 1.0, 1000.0, "mm", kMilli, to.diameter);
  screw.must("lead_mm", 0.1, 1000.0, "mm", kMilli, to.lead);
  screw.must("length_mm", 10.0, 20000.0, "mm", kMilli, to.length);
  screw.must("end_diameter_mm", 1.0, 1000.0, "mm", kMilli, to.end_diameter);
  screw.must("end_length_mm", 1.0, 5000.0, "mm", kMilli, to.end_length);
  screw.may("density_kg_per_m3", 100.0, 30000.0, "kg/m3", 1.0, to.density);
  screw.may("youngs_modulus_gpa", 1.0, 2000.0, "GPa", kGiga, to.youngs_modulus);
  screw.may("shear_modulus_gpa", 1.0, 2000.0, "GPa", kGiga, to.shear_modulus);
  read_material(screw, "axial", to.axial);
  read_material(screw, "torsional", to.torsional);
  screw->integer("elements", 2, 64, to.elements);
  screw->refuse_unknown();
}

void read_axial(Part& part, SpringDamper& to) {
  part.must("stiffness_n_per_um", 0.1, 1e6, "N/um", kPerMicrometre, to.stiffness);
  part.may("damping_n_s_per_m", 0.0, 1e8, "N s/m", 1.0, to.damping);
}

void read_nut(Part nut, const ScrewParts& screw, NutParts& to) {
  read_axial(nut, to.spring);
  if (nut->given() && !nut->has("travel_mm")) nut->report_missing("travel_mm", "is missing");
  double from = 0.0, most = 1.0;
  nut->range("travel_mm", 0.0, screw.length / kMilli, "mm from the bearing", from, most);
  to.from = from * kMilli;
  to.to = most * kMilli;
  to.at_zero = to.from;
  nut.may("at_zero_mm", -20000.0, 20000.0, "mm from the bearing", kMilli, to.at_zero);
  nut->refuse_unknown();
}

void read_current_loop(Section& control, ControlParts& to) {
  Part loop(control.section("current_loop"));
  if (!loop->given()) return;
  CurrentLoopParts parts;
  loop.must("resistance_ohm", 1e-4, 1e4, "Ohm", 1.0, parts.resistance);
  loop.must("inductance_mh", 1e-4, 1e5, "mH", kMilli, parts.inductance);
  loop.must("gain_v_per_a", 1e-4, 1e6, "V/A", 1.0, parts.gain);
  loop.must("reset_time_ms", 1e-3, 1e5, "ms", kMilli, parts.reset_time);
  loop->refuse_unknown();
  if (control.has("current_loop_hz"))
    control.report("current_loop_hz",
                   "[control.current_loop] is given as well; remove one of the two");
  to.current_loop = parts;
}

void read_band_stops(Section& control, double most_hz, Problems& problems, ControlParts& to) {
  const toml::node* node = control.find("band_stop");
  if (node == nullptr) return;
  const toml::array* stops = node->as_array();
  if (stops == nullptr || !stops->is_array_of_tables() || stops->size() > 8) {
    control.report("band_stop", "must be given as up to 8 [[control.band_stop]] tables");
    return;
  }
  for (const toml::node& entry : *stops) {
    Part part(Section(entry.as_table(), "control.band_stop", problems));
    BandStop stop;
    part.must("frequency_hz", 1.0, most_hz, "Hz (half of rate_hz)", 1.0, stop.frequency_hz);
    part.must("bandwidth_hz", 0.1, 1e5, "Hz", 1.0, stop.bandwidth_hz);
    part.may("numerator_bandwidth_hz", 0.0, 1e5, "Hz", 1.0, stop.numerator_bandwidth_hz);
    part->refuse_unknown();
    to.band_stops.push_back(stop);
  }
}

void read_control(Part control, Problems& problems, ControlParts& to) {
  control.may("rate_hz", 500.0, 200000.0, "Hz", 1.0, to.rate_hz);
  const double most_hz = 0.499 * to.rate_hz;
  control.must("position_gain_per_s", 0.1, 1e4, "1/s", 1.0, to.position_gain);
  control.must("velocity_gain_nm_s_per_rad", 1e-6, 1e6, "Nm s/rad", 1.0, to.velocity_gain);
  control.must("velocity_reset_time_ms", 0.1, 1e6, "ms", kMilli, to.reset_time);
  control.may("current_loop_hz", 1.0, 1e5, "Hz", 1.0, to.current_loop_hz);
  double low_pass = 0.0;
  control.may("low_pass_hz", 1.0, most_hz, "Hz (half of rate_hz)", 1.0, low_pass);
  if (low_pass > 0.0) to.low_pass_hz = low_pass;
  read_current_loop(*control.operator->(), to);
  read_band_stops(*control.operator->(), most_hz, problems, to);
  control->refuse_unknown();
}

void read_friction(Part friction, std::optional<LuGreParts>& to) {
  if (!friction->given()) return;
  LuGreParts parts;
  friction.must("breakaway_n", 1e-3, 1e6, "N", 1.0, parts.breakaway);
  friction.must("coulomb_n", 1e-3, 1e6, "N", 1.0, parts.coulomb);
  friction.must("stribeck_velocity_mm_per_s", 1e-3, 1e4, "mm/s", kMilli, parts.stribeck_velocity);
  friction.may("stribeck_exponent", 0.1, 10.0, "", 1.0, parts.stribeck_exponent);
  friction.must("stiffness_n_per_um", 1e-4, 1e5, "N/um", kPerMicrometre, parts.stiffness);
  friction.may("damping_n_s_per_m", 0.0, 1e8, "N s/m", 1.0, parts.damping);
  friction.may("viscous_n_s_per_m", 0.0, 1e6, "N s/m", 1.0, parts.viscous);
  friction->refuse_unknown();
  to = parts;
}

void read_added_mass(Part mass, std::optional<AddedMass>& to) {
  if (!mass->given()) return;
  AddedMass parts;
  mass.must("mass_kg", 0.01, 1e6, "kg", 1.0, parts.mass);
  read_axial(mass, parts.spring);
  mass->refuse_unknown();
  to = parts;
}

FeedAxisParts parts_of(const toml::table& table, Problems& problems) {
  FeedAxisParts to;
  Section root(&table, "", problems);
  read_screw(required(root, "screw"), to.screw);
  Part bearing = required(root, "bearing");
  read_axial(bearing, to.bearing);
  bearing->refuse_unknown();
  Part coupling = required(root, "coupling");
  coupling.must("stiffness_nm_per_rad", 1.0, 1e8, "Nm/rad", 1.0, to.coupling.spring.stiffness);
  coupling.may("damping_nm_s_per_rad", 0.0, 1e6, "Nm s/rad", 1.0, to.coupling.spring.damping);
  coupling.must("inertia_kg_cm2", 1e-3, 1e6, "kg cm2", kSquareCentimetre, to.coupling.inertia);
  coupling->refuse_unknown();
  read_nut(required(root, "nut"), to.screw, to.nut);
  Part motor = required(root, "motor");
  motor.must("inertia_kg_cm2", 1e-3, 1e7, "kg cm2", kSquareCentimetre, to.motor_inertia);
  motor->refuse_unknown();
  Part mass = required(root, "table");
  mass.must("mass_kg", 0.01, 1e6, "kg", 1.0, to.table_mass);
  mass->refuse_unknown();
  read_added_mass(root.section("added_mass"), to.added_mass);
  read_control(required(root, "control"), problems, to.control);
  read_friction(root.section("friction"), to.friction);
  read_friction(root.section("cover"), to.cover);
  root.refuse_unknown();
  return to;
}

CheckedFeedAxis check_table(const toml::table& table, const std::string& name) {
  CheckedFeedAxis out;
  Problems problems(name, out.problems);
  out.parts = parts_of(table, problems);
  problems.sort();
  return out;
}

/// Sets the key of "section.key=value" to its value; throws std::invalid_argument.
void change(toml::table& table, const std::string& what) {
  const auto refuse = [&](const std::string& why) {
    throw std::invalid_argument("--set " + in_quotes(what) + ": " + why);
  };
  const std::size_t equals = what.find('=');
  const std::string path(trimmed(std::string_view(what).substr(0, equals)));
  if (equals == what.npos || path.find('.') == path.npos)
    refuse("must be section.key=value, such as coupling.stiffness_nm_per_rad=30000");
  toml::table parsed;
  try {
    parsed = parse_toml("value = " + what.substr(equals + 1), "");
  } catch (const toml::parse_error&) {
    refuse("the value must be a number, [from, to] or a text in quotes");
  }
  toml::node* at = &table;
  const std::vector<std::string> names = split_fields(path, '.');
  for (std::size_t i = 0; i + 1 < names.size(); ++i) {
    toml::node* next = nullptr;
    if (toml::table* inner = at->as_table()) {
      if (!inner->contains(names[i])) inner->insert(names[i], toml::table{});
      next = inner->get(names[i]);
    } else if (toml::array* list = at->as_array()) {
      std::size_t number = 0;
      const char* end = names[i].data() + names[i].size();
      if (std::from_chars(names[i].data(), end, number).ptr != end || number < 1 ||
          number > list->size())
        refuse("there is no number " + names[i] + "; the file has " + std::to_string(list->size()));
      next = list->get(number - 1);
    }
    if (next == nullptr || next->is_value()) refuse(in_quotes(names[i]) + " is not a section");
    at = next;
  }
  if (at->as_table() == nullptr)
    refuse("give the number of one of them: control.band_stop.1." + names.back());
  at->as_table()->insert_or_assign(names.back(), std::move(*parsed.get("value")));
}

}  // namespace

CheckedFeedAxis check_feed_axis(std::string_view text, const std::string& name) {
  try {
    return check_table(parse_toml(text, name), name);
  } catch (const toml::parse_error& error) {
    CheckedFeedAxis out;
    Problems(name, out.problems).add(error.source(), std::string(error.description()));
    return out;
  }
}

FeedAxisParts read_feed_axis(const std::filesystem::path& file,
                             const std::vector<std::string>& changes) {
  const std::string text = read_text(file);
  CheckedFeedAxis checked = check_feed_axis(text, file.string());
  if (!checked.problems.empty()) throw std::runtime_error(messages(checked.problems));
  toml::table table = parse_toml(text, file.string());
  for (const std::string& one : changes) {
    change(table, one);
    checked = check_table(table, file.string());
    // The file itself had no problem, so the change causes it.
    if (!checked.problems.empty())
      throw std::invalid_argument("--set " + in_quotes(one) + ": " + checked.problems[0].what);
  }
  return checked.parts;
}

std::string with_fitted(const std::filesystem::path& file, const FeedAxisParts& parts) {
  toml::table table = parse_toml(read_text(file), file.string());
  const auto set = [&](const std::string& section, const std::string& key, double value) {
    if (!table.contains(section)) table.insert(section, toml::table{});
    table.get(section)->as_table()->insert_or_assign(key, value);
  };
  const auto axial = [&](const std::string& section, const SpringDamper& spring) {
    set(section, "stiffness_n_per_um", spring.stiffness / kPerMicrometre);
    set(section, "damping_n_s_per_m", spring.damping);
  };
  set("coupling", "stiffness_nm_per_rad", parts.coupling.spring.stiffness);
  set("coupling", "damping_nm_s_per_rad", parts.coupling.spring.damping);
  axial("bearing", parts.bearing);
  axial("nut", parts.nut.spring);
  for (const auto& [section, friction] :
       {std::pair{"friction", &parts.friction}, {"cover", &parts.cover}}) {
    if (!*friction) continue;
    const LuGreParts& law = **friction;
    set(section, "breakaway_n", law.breakaway);
    set(section, "coulomb_n", law.coulomb);
    set(section, "stribeck_velocity_mm_per_s", law.stribeck_velocity / kMilli);
    axial(section, {law.stiffness, law.damping});
    set(section, "viscous_n_s_per_m", law.viscous);
  }
  std::ostringstream out;
  out << table << "\n";
  return out.str();
}

}  // namespace servotwin
