#include "drivers/can/can_map.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <stdexcept>

#include "drivers/can/can_frame.h"
#include "drivers/can/can_map_source.h"
#include "drivers/common/file_handle.h"
#include "drivers/common/text.h"
#include "drivers/common/toml_section.h"
#include "drivers/common/units.h"

namespace servotwin {
namespace {

struct ChannelKind {
  CanChannel channel;
  const char* key;
  std::uint16_t object;  // of CiA 402; 0: not of a drive
  enum { kPosition, kDifference, kTorque, kBits, kFlag } kind;
  bool to_drive;  // or to a PLC

  [[nodiscard]] bool has_unit() const { return kind != kBits && kind != kFlag; }
};
constexpr std::array<ChannelKind, kCanChannels> kKinds{{
    {CanChannel::kCommand, "command", 0x6062, ChannelKind::kPosition, false},
    {CanChannel::kActual, "actual", 0x6064, ChannelKind::kPosition, false},
    {CanChannel::kTorque, "torque", 0x6077, ChannelKind::kTorque, false},
    {CanChannel::kFollowingError, "following_error", 0x60F4, ChannelKind::kDifference, false},
    {CanChannel::kStatusWord, "status_word", 0x6041, ChannelKind::kBits, false},
    {CanChannel::kTarget, "target", 0x607A, ChannelKind::kPosition, true},
    {CanChannel::kOffset, "offset", 0x60B0, ChannelKind::kDifference, true},
    {CanChannel::kControlWord, "control_word", 0x6040, ChannelKind::kBits, true},
    {CanChannel::kPredictedError, "predicted_error", 0, ChannelKind::kDifference, true},
    {CanChannel::kResidual, "residual", 0, ChannelKind::kDifference, true},
    {CanChannel::kPredictionValid, "prediction_valid", 0, ChannelKind::kFlag, true},
    {CanChannel::kAlarm, "alarm", 0, ChannelKind::kFlag, true},
}};
// CiA 402: torque in thousandths of the rated one.
constexpr const char* kPerMille = "%*0.1";
// The event timer of a PDO has 16 bits of 1 ms (CiA 301).
constexpr double kMaxOffsetTimeout_s = 65.535;

/// The units of an axis, as given in the mapping.
struct AxisUnits {
  bool rotary = false;
  double lead_m = 0.0;  // per turn of the screw; 0: not given
  double gear_ratio = 1.0;
  bool invert = false;
  bool gear_given = false;
  mutable bool gear_used = false;
};

std::vector<const toml::table*> tables(Section& section, const std::string& key) {
  std::vector<const toml::table*> out;
  const toml::node* node = section.find(key);
  if (node == nullptr) return out;
  const toml::array* array = node->as_array();
  if (array == nullptr || !array->is_array_of_tables()) {
    section.report(key, "must be given as [[" + key + "]] tables");
    return out;
  }
  for (const toml::node& entry : *array) out.push_back(entry.as_table());
  return out;
}

class MapReader {
 public:
  MapReader(const std::filesystem::path& folder, CanMap& map, Problems& problems, Mapped mapped)
      : sources_(folder, map.notes), map_(map), problems_(problems), mapped_(mapped) {}

  void read(const toml::table& table) {
    Section root(&table, "", problems_);
    if (!root.has("cycle_s"))
      root.report_missing("cycle_s", "is missing; how long is a cycle [s]?");
    root.number("cycle_s", kMinCycle_s, kMaxCycle_s, "s", map_.machine.cycle_s);
    map_.deadline_s = 0.9 * map_.machine.cycle_s;
    root.number("deadline_s", 1e-6, 1.0, "s", map_.deadline_s);
    read_buses(root);
    read_nodes(root);
    read_start(root);
    const auto axes = tables(root, "axis");
    if (axes.empty() && !root.has("axis"))
      root.report_missing("axis", "is missing; a mapping has at least one [[axis]]");
    if (axes.size() > kMaxAxes) {
      root.report("axis", "a machine has at most " + std::to_string(kMaxAxes) + " axes, not " +
                              std::to_string(axes.size()));
    }
    for (std::size_t i = 0; i < std::min<std::size_t>(axes.size(), kMaxAxes); ++i)
      read_axis(*axes[i]);
    read_prediction_period(root);
    root.refuse_unknown();
    name_messages();
  }

 private:
  void read_prediction_period(Section& root) {
    root.number("prediction_period_s", kMinCycle_s, 60.0, "s", map_.prediction_period_s);
    if (root.has("prediction_period_s") && prediction_messages(map_).empty())
      root.report("prediction_period_s",
                  "has no effect: no predicted_error, residual, prediction_valid or alarm of an "
                  "axis is mapped");
  }

  void read_buses(Section& root) {
    for (const toml::table* table : tables(root, "bus")) {
      Section bus(table, "bus", problems_);
      std::string name, dbc;
      if (!bus.has("name")) bus.report_missing("name", "every bus needs that of its interface");
      bus.name("name", 31, name);
      bus.text("dbc", 1, 4096, dbc);
      for (const std::string& other : map_.buses) {
        if (!name.empty() && other == name)
          bus.report("name", "there is a bus of this name already");
      }
      map_.buses.push_back(name);
      if (!dbc.empty()) attempt(bus, "dbc", [&] { sources_.add_dbc(map_.buses.size() - 1, dbc); });
      bus.refuse_unknown();
    }
    if (map_.buses.empty()) map_.buses.emplace_back("can0");
  }

  void read_nodes(Section& root) {
    for (const toml::table* table : tables(root, "node")) {
      Section node(table, "node", problems_);
      int id = 0;
      std::string file;
      const std::size_t bus = bus_of(node);
      node.integer("id", 1, 127, id);
      if (!node.has("eds"))
        node.report_missing("eds", "is missing; which file describes the node?");
      node.text("eds", 1, 4096, file);
      bool there = false;
      if (!file.empty())
        there = attempt(node, "eds", [&] { id = sources_.add_node(bus, id, file); });
      for (const char* kind : {"tpdo", "rpdo"}) {
        for (const toml::table* pdo : tables(node, kind)) {
          Section section(pdo, std::string("node.") + kind, problems_);
          if (there) read_pdo(section, bus, id, kind[0] == 't');
        }
      }
      node.refuse_unknown();
    }
  }

  /// A PDO that the controller maps when it starts.
  void read_pdo(Section& section, std::size_t bus, int node, bool transmit) {
    int number = 0, can_id = 0;
    for (const char* key : {"number", "objects"}) {
      if (!section.has(key))
        section.report_missing(key, "is missing; which objects are in which PDO?");
    }
    section.integer("number", 1, 512, number);
    section.integer("id", 1, static_cast<int>(kExtendedIds - 1), can_id);
    std::vector<std::pair<int, int>> objects;
    if (const toml::node* given = section.find("objects")) {
      constexpr const char* kRule =
          "must be a list of objects such as 0x6064 or, with a sub-index, [0x60C1, 1]";
      const toml::array* list = given->as_array();
      bool good = list != nullptr && !list->empty();
      for (std::size_t i = 0; good && i < list->size(); ++i) {
        const toml::node& entry = *list->get(i);
        const toml::array* pair = entry.as_array();
        const auto part = [&](std::size_t k) {
          const toml::node* one = pair == nullptr ? (k == 0 ? &entry : nullptr) : pair->get(k);
          return one == nullptr ? std::optional<std::int64_t>(k) : one->value_exact<std::int64_t>();
        };
        const auto index = part(0),
                   sub = pair == nullptr ? std::optional<std::int64_t>(0) : part(1);
        good = index && sub && *index >= 0x1000 && *index <= 0xFFFF && *sub >= 0 && *sub <= 255;
        if (good) objects.emplace_back(static_cast<int>(*index), static_cast<int>(*sub));
      }
      if (!good) section.report("objects", kRule);
    }
    section.refuse_unknown();
    if (number == 0 || objects.empty()) return;
    attempt(section, "objects", [&] {
      sources_.map_pdo(
          bus, node, transmit, number,
          can_id == 0 ? std::nullopt : std::optional(static_cast<std::uint32_t>(can_id)), objects);
    });
  }

  void read_start(Section& root) {
    int id = static_cast<int>(map_.start.id);
    root.integer("sync", 1, static_cast<int>(kExtendedIds - 1), id);
    map_.start.id = static_cast<std::uint32_t>(id);
    map_.start.extended = map_.start.id >= kStandardIds;
    map_.start.bus = bus_of(root, "sync_bus");
  }

  std::size_t bus_of(Section& section, const std::string& key = "bus") {
    std::string name;
    section.text(key, 1, 31, name);
    if (name.empty()) return 0;
    for (std::size_t i = 0; i < map_.buses.size(); ++i) {
      if (map_.buses[i] == name) return i;
    }
    section.report(key, "there is no bus of this name; there is " + listed(map_.buses));
    return 0;
  }

  void read_axis(const toml::table& table) {
    Section axis(&table, "axis", problems_);
    AxisDescription description;
    AxisUnits units;
    std::string kind = "m";
    if (!axis.has("name")) axis.report_missing("name", "every axis needs one");
    axis.name("name", 31, description.name);
    axis.one_of("units", {"m", "rad"}, kind);
    description.rotary = units.rotary = kind == "rad";
    for (const AxisDescription& other : map_.machine.axes) {
      if (!description.name.empty() && other.name == description.name)
        axis.report("name", "there is an axis of this name already");
    }
    double lead_mm = 0.0;
    axis.number("lead_mm", 1e-3, 1e6, "mm", lead_mm);
    axis.number("gear_ratio", 1e-6, 1e6, "", units.gear_ratio);
    axis.flag("invert", units.invert);
    units.lead_m = lead_mm / 1e3;
    units.gear_given = axis.has("lead_mm") || axis.has("gear_ratio");

    SignalDefaults defaults;
    defaults.bus = bus_of(axis);
    axis.integer("node", 1, 127, defaults.node);
    axis.text("position_unit", 1, 40, defaults.position_unit);
    axis.text("torque_unit", 1, 40, defaults.torque_unit);
    axis.number("rollover", 1.0, 1e18, "steps", defaults.rollover);
    if (defaults.node != 0 && !sources_.has_node(defaults.bus, defaults.node))
      axis.report("node", "there is no [[node]] with this id on this bus");

    map_.machine.axes.push_back(description);
    bool failed = false;
    for (const ChannelKind& channel : kKinds)
      failed = !read_channel(axis, channel, defaults, units) || failed;
    const std::size_t index = map_.machine.axes.size() - 1;
    const bool commanded = map_.find(index, CanChannel::kCommand) != nullptr ||
                           (map_.find(index, CanChannel::kActual) != nullptr &&
                            map_.find(index, CanChannel::kFollowingError) != nullptr);
    if (!commanded && !failed && mapped_ == Mapped::kWholeAxes) {
      axis.report_missing(
          "command", "no signal is the command of axis " + in_quotes(description.name) +
                         ", nor actual and following_error from which it follows" +
                         (defaults.node == 0 ? "" : sources_.pdos_of(defaults.bus, defaults.node)));
    }
    if (units.gear_given && !units.gear_used && !failed) {
      axis.report(axis.has("lead_mm") ? "lead_mm" : "gear_ratio",
                  "has no effect: no position of this axis is given as an angle [rev, rad, deg]");
    }
    read_offset_timeout(axis, index, failed);
    if (!failed) require_validity(axis, index);
    axis.refuse_unknown();
  }

  /// A PLC must be able to tell 0 from not known.
  void require_validity(Section& axis, std::size_t index) {
    const MappedSignal* valid = map_.find(index, CanChannel::kPredictionValid);
    for (const CanChannel channel : {CanChannel::kPredictedError, CanChannel::kResidual}) {
      const MappedSignal* figure = map_.find(index, channel);
      if (figure != nullptr && (valid == nullptr || valid->message != figure->message))
        axis.report(std::string(name_of(channel)),
                    "is sent as 0 where it is not known: map prediction_valid of this axis into "
                    "the same message");
    }
  }

  /// What the drive does when offsets stop.
  void read_offset_timeout(Section& axis, std::size_t index, bool failed) {
    constexpr const char* kKey = "offset_timeout_s";
    const toml::node* node = axis.find(kKey);
    if (node == nullptr) return;
    double timeout_s = std::numeric_limits<double>::infinity();
    if (node->value_exact<std::string>() != "none") {
      const auto given = node->is_number() ? node->value<double>() : std::nullopt;
      if (!given || !(*given >= 1e-3 && *given <= kMaxOffsetTimeout_s)) {
        axis.report(kKey,
                    "must be a number from 0.001 to 65.535 s, or \"none\" if the drive keeps "
                    "an offset that is not renewed");
        return;
      }
      timeout_s = *given;
    }
    for (MappedSignal& signal : map_.signals) {
      if (signal.axis != index || signal.channel != CanChannel::kOffset) continue;
      signal.timeout_s = timeout_s;
      return;
    }
    if (!failed) axis.report(kKey, "has no effect: no offset of this axis is mapped");
  }

  /// Returns false if the signal has a problem.
  bool read_channel(Section& axis, const ChannelKind& kind, const SignalDefaults& defaults,
                    const AxisUnits& units) {
    Section section = axis.section(kind.key);
    if (!section.given()) {
      if (kind.object == 0 || defaults.node == 0 || !sources_.has_node(defaults.bus, defaults.node))
        return true;
      const auto found =
          sources_.find_object(defaults.bus, defaults.node, kind.object, 0, kind.to_drive);
      return !found || add_signal(axis, "node", kind, *found, "", 0.0, defaults, units);
    }
    SignalDefaults own = defaults;
    own.bus = section.has("bus") ? bus_of(section) : defaults.bus;
    SignalKeys keys = read_signal_keys(section, own, kind.object);
    section.refuse_unknown();
    if (keys.failed) return false;
    std::optional<SourceSignal> source;
    const bool done =
        attempt(axis, kind.key, [&] { source = sources_.resolve(keys, kind.to_drive); });
    return done && add_signal(axis, kind.key, kind, *source, keys.unit, keys.rollover, own, units);
  }

  bool add_signal(Section& axis, const std::string& key, const ChannelKind& kind,
                  const SourceSignal& source, const std::string& given_unit, double rollover,
                  const SignalDefaults& defaults, const AxisUnits& units) {
    MappedSignal signal;
    signal.signal = source.signal;
    signal.channel = kind.channel;
    signal.axis = map_.machine.axes.size() - 1;
    signal.origin = source.origin;
    std::string unit = given_unit;
    if (kind.kind == ChannelKind::kTorque) {
      if (unit.empty()) unit = defaults.torque_unit;
      if (unit.empty()) unit = source.unit;
      if (unit.empty() && source.object == 0x6077) unit = kPerMille;
    } else if (kind.has_unit()) {
      if (unit.empty()) unit = source.unit;
      if (unit.empty()) unit = defaults.position_unit;
    }
    double factor = 1.0;
    if (kind.has_unit()) {
      const std::string what = source.origin + " (" + kind.key + ")";
      if (unit.empty()) {
        axis.report(key, what +
                             ": there is no unit; give position_unit of the axis or unit of the "
                             "signal, such as \"um*0.1\" or \"rev/131072\" for one step");
        return false;
      }
      const auto parsed = parse_unit(unit);
      if (!parsed) {
        axis.report(key, what + ": the unit " + in_quotes(unit) + " is not known; known are " +
                             std::string(kKnownUnits) + ", also scaled: rev/8192, um*0.1");
        return false;
      }
      const std::string problem = kind.kind == ChannelKind::kTorque
                                      ? torque_factor(*parsed, factor)
                                      : position_factor(*parsed, units, factor);
      if (!problem.empty()) {
        axis.report(key, what + " in [" + unit + "]: " + problem);
        return false;
      }
      if (units.invert && kind.object != 0) factor = -factor;
    }
    if (kind.kind == ChannelKind::kFlag) signal.signal.coding = Coding::kUnsigned;
    if (kind.kind == ChannelKind::kPosition) {
      double steps = rollover > 0.0 ? rollover : defaults.rollover;
      if (steps == 0.0 && signal.signal.coding != Coding::kFloat && signal.signal.length < 64)
        steps = std::ldexp(1.0, signal.signal.length);
      signal.turn = std::abs(steps * signal.signal.scale * factor);
    }
    signal.signal.scale *= factor;
    signal.signal.offset *= factor;
    std::string problem = is_prediction(kind.channel) ? untellable(signal.signal, kind) : "";
    if (problem.empty()) problem = shared_wrongly(source.message, kind);
    if (problem.empty()) problem = place(source.message, kind, signal.message);
    if (!problem.empty()) {
      axis.report(key, problem);
      return false;
    }
    map_.signals.push_back(std::move(signal));
    return true;
  }

  std::string torque_factor(const Unit& unit, double& factor) {
    if (unit.quantity != Quantity::kTorque) return "a torque needs one of N kN Nm A V %";
    factor = unit.to_si(1.0);
    map_.machine.axes.back().torque_unit = unit.si;
    return "";
  }

  static std::string position_factor(const Unit& unit, const AxisUnits& units, double& factor) {
    factor = unit.to_si(1.0);
    if (unit.quantity == Quantity::kLength) {
      return units.rotary ? "a rotary axis (units = \"rad\") needs an angle: rad, deg or rev" : "";
    }
    if (unit.quantity != Quantity::kAngle) return "a position needs a length or an angle";
    units.gear_used = true;
    factor /= units.gear_ratio;
    if (units.rotary) return "";
    if (units.lead_m == 0.0)
      return "an angle of a linear axis: give lead_mm, the travel per turn of the screw";
    factor *= units.lead_m / (2.0 * std::numbers::pi);
    return "";
  }

  /// Why the bits of a signal cannot tell a PLC what they are for; empty if they can.
  std::string untellable(const CanSignal& signal, const ChannelKind& kind) const {
    std::uint64_t one = 0, other = 0;
    if (kind.kind == ChannelKind::kFlag) {
      const bool both = encoded(signal, 0.0, false, one) && encoded(signal, 1.0, false, other);
      return both && one != other ? ""
                                  : "must be able to be 0 and 1: give it the scale 1 and the "
                                    "offset 0";
    }
    const double step = std::abs(signal.scale);
    if (encoded(signal, -step, false, one) && encoded(signal, step, false, other)) return "";
    const double top = std::ldexp(1.0, signal.length);
    const double low = signal.coding == Coding::kSigned ? -0.5 * top : 0.0;
    const auto [least, most] = std::minmax(
        {low * signal.scale + signal.offset, (low + top - 1.0) * signal.scale + signal.offset});
    return "has both signs, and is 0 where it is not known, but its bits hold " + number(least) +
           " to " + number(most) + (map_.machine.axes.back().rotary ? " rad" : " m") +
           ": make it signed, or change its offset";
  }

  /// Why the id of a message to a PLC cannot be this one, or that of another message; empty if it
  /// can.
  std::string shared_wrongly(const MappedMessage& message, const ChannelKind& kind) const {
    const bool to_plc = is_prediction(kind.channel);
    if (to_plc && message.bus == map_.start.bus && message.id == map_.start.id &&
        message.extended == map_.start.extended)
      return message.name + " begins the cycles; a message to a PLC needs an id of its own";
    for (const MappedSignal& other : map_.signals) {
      const MappedMessage& its = map_.messages[other.message];
      if (its.bus != message.bus || its.id != message.id || its.extended != message.extended ||
          is_prediction(other.channel) == to_plc)
        continue;
      return message.name + " carries " + std::string(name_of(other.channel)) + " of axis " +
             map_.machine.axes[other.axis].name +
             " as well; a message to a PLC needs an id of its own";
    }
    return "";
  }

  /// Finds or adds the message of a signal in the map; returns the problem, or an empty text.
  std::string place(const MappedMessage& wanted, const ChannelKind& kind, std::size_t& index) {
    const auto same = [&](const MappedMessage& m) {
      return m.bus == wanted.bus && m.id == wanted.id && m.extended == wanted.extended &&
             m.selector.has_value() == wanted.selector.has_value() &&
             (!m.selector || m.selector->value == wanted.selector->value);
    };
    for (index = 0; index < map_.messages.size() && !same(map_.messages[index]); ++index) {
    }
    if (index == map_.messages.size()) map_.messages.push_back(wanted);
    MappedMessage& message = map_.messages[index];
    if (message.at_least && wanted.at_least) {
      message.length = std::max(message.length, wanted.length);
    } else {
      const bool contradicts =
          (!message.at_least && wanted.length > message.length) ||
          (!wanted.at_least && message.length > wanted.length) ||
          (!message.at_least && !wanted.at_least && message.length != wanted.length);
      if (contradicts) {
        return message.name + " has " + std::to_string(message.length) +
               " bytes for one signal and " + std::to_string(wanted.length) + " for another";
      }
      if (!wanted.at_least) {
        message.length = wanted.length;
        message.at_least = false;
      }
    }
    message.from_machine =
        message.from_machine || (!kind.to_drive && kind.kind != ChannelKind::kBits);
    return "";
  }

  void name_messages() {
    for (std::size_t i = 0; i < map_.messages.size(); ++i) {
      std::vector<std::string> axes;
      for (const MappedSignal& signal : map_.signals) {
        const std::string& axis = map_.machine.axes[signal.axis].name;
        if (signal.message == i && std::find(axes.begin(), axes.end(), axis) == axes.end())
          axes.push_back(axis);
      }
      std::string& name = map_.messages[i].name;
      if (map_.buses.size() > 1) name += " on " + map_.buses[map_.messages[i].bus];
      name += (axes.size() == 1 ? " of axis " : " of axes ") + listed(axes);
    }
  }

  /// Turns an exception into a problem at this key.
  template <class Action>
  bool attempt(Section& section, const std::string& key, Action&& action) {
    try {
      action();
      return true;
    } catch (const std::exception& error) {
      section.report(key, error.what());
      return false;
    }
  }

  SignalSources sources_;
  CanMap& map_;
  Problems& problems_;
  Mapped mapped_;
};

}  // namespace

std::string_view name_of(CanChannel channel) noexcept {
  for (const ChannelKind& kind : kKinds) {
    if (kind.channel == channel) return kind.key;
  }
  return "";
}

const MappedSignal* CanMap::find(std::size_t axis, CanChannel channel) const noexcept {
  for (const MappedSignal& signal : signals) {
    if (signal.axis == axis && signal.channel == channel) return &signal;
  }
  return nullptr;
}

std::vector<std::size_t> prediction_messages(const CanMap& map) {
  std::vector<std::size_t> out;
  for (const MappedSignal& signal : map.signals) {
    if (is_prediction(signal.channel) &&
        std::find(out.begin(), out.end(), signal.message) == out.end())
      out.push_back(signal.message);
  }
  return out;
}

CheckedCanMap check_can_map(std::string_view text, const std::string& name,
                            const std::filesystem::path& folder, Mapped mapped) {
  CheckedCanMap out;
  Problems problems(name, out.problems);
  try {
    MapReader(folder, out.map, problems, mapped).read(parse_toml(text, name));
    problems.sort();
  } catch (const toml::parse_error& error) {
    problems.add(error.source(), std::string(error.description()));
  }
  return out;
}

CanMap load_can_map(const std::filesystem::path& file, Mapped mapped) {
  CheckedCanMap checked = check_can_map(read_text(file), file.string(), file.parent_path(), mapped);
  if (!checked.problems.empty()) throw std::runtime_error(messages(checked.problems));
  return std::move(checked.map);
}

}  // namespace servotwin
