#include "daemon/input/machine_input.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "daemon/input/can_source.h"
#include "daemon/input/joined_source.h"
#include "daemon/input/offset_contract.h"
#include "daemon/input/recorded_cycles.h"
#include "drivers/can/can_udp.h"
#include "drivers/can/socketcan.h"
#include "drivers/common/text.h"
#include "drivers/recordings/can_log/can_log.h"
#include "drivers/recordings/recording_file.h"
#include "drivers/recordings/replay.h"
#include "twin/contour.h"

namespace servotwin::daemon {
namespace {

MachineDescription described_by(const Config& config) {
  MachineDescription machine;
  machine.cycle_s = config.cycle_s.value_or(0.001);
  for (const AxisConfig& axis : config.axes)
    machine.axes.push_back({axis.name, axis.rotary, axis.torque_unit});
  return machine;
}

/// One of the recordings to replay, with the notes about it.
struct ReadReplay {
  Replay replay;
  std::vector<std::string> notes;
};

ReadReplay read_replay(const Config& config, const std::filesystem::path& file) {
  ReadOptions options;
  options.columns = config.replay.columns;
  if (is_can_log(file)) options.can_map = config.replay.can_map;
  RecordedCycles cycles = recorded_cycles(read_recording(file, options));
  std::vector<std::string> notes = cycles.recording.notes;
  notes.insert(notes.end(), cycles.notes.begin(), cycles.notes.end());
  return {Replay(std::move(cycles.recording), cycles.cycle_s), std::move(notes)};
}

MachineInput replaying(const Config& config, EventLog& events) {
  std::vector<Replay> recordings;
  for (const std::filesystem::path& file : config.replay.files) {
    ReadReplay read = read_replay(config, file);
    for (const std::string& note : read.notes) events.note("source", "", note);
    recordings.push_back(std::move(read.replay));
  }
  auto source = std::make_unique<ReplaySource>(std::move(recordings), config.replay.speed);
  const MachineDescription machine = source->machine();
  return {std::move(source), machine};
}

/// The mapping of the buses that the configuration names, checked against the rest of it.
CanMap mapping(const Config& config) {
  const bool udp = config.uses(SourceKind::kUdp);
  CanMap map = load_can_map(udp ? config.udp.map : config.can.map,
                            config.second ? Mapped::kChannels : Mapped::kWholeAxes);
  if (config.source != SourceKind::kDds && config.cycle_s &&
      *config.cycle_s != map.machine.cycle_s) {
    throw std::runtime_error("machine.cycle_s is " + number(*config.cycle_s) +
                             " s, but cycle_s of the CAN mapping is " +
                             number(map.machine.cycle_s) + " s; remove machine.cycle_s");
  }
  if (udp && map.buses.size() > 1) {
    throw std::runtime_error("CAN over UDP is one bus, but the mapping has " +
                             std::to_string(map.buses.size()) + ": " + listed(map.buses));
  }
  if (!udp && !config.can.interfaces.empty()) {
    if (config.can.interfaces.size() != map.buses.size()) {
      throw std::runtime_error("source.can.interfaces names " +
                               std::to_string(config.can.interfaces.size()) +
                               " interfaces, but the mapping has the buses " + listed(map.buses));
    }
    map.buses = config.can.interfaces;
  }
  return map;
}

std::vector<std::string> names_of(const std::vector<std::size_t>& messages, const CanMap& map) {
  std::vector<std::string> out;
  for (const std::size_t message : messages) out.push_back(map.messages[message].name);
  return out;
}

MachineInput listening(const Config& config, EventLog& events) {
  CanMap map = mapping(config);
  for (const std::string& note : map.notes) events.note("source", "", note);
  std::vector<std::unique_ptr<CanBus>> buses;
  Pacing pacing = Pacing::kByStamp;
  if (config.uses(SourceKind::kUdp)) {
    buses.push_back(std::make_unique<CanUdp>(CanUdpPlace{config.udp.listen, config.udp.peer}));
    map.buses.front() = config.udp.listen;
    pacing = Pacing::kByCount;
  } else {
    for (std::size_t i = 0; i < map.buses.size(); ++i) {
      SocketCanOptions options;
      if (config.can.filter) options.only = ids_of(map, i);
      buses.push_back(std::make_unique<SocketCan>(map.buses[i], std::move(options)));
    }
  }
  events.note("source", "", "listening to " + listed(map.buses));
  auto source = std::make_unique<CanSource>(map, std::move(buses), pacing);
  if (config.ilc.live && !config.second) source->carry_offsets(corrected_axes(config));
  if (config.second) {
    if (!prediction_messages(map).empty())
      events.note("source", "", "with two sources no predictions are sent to a PLC");
  } else if (!prediction_messages(map).empty()) {
    source->tell_predictions();
    events.note("source", "",
                "predictions are sent every " + number(1e3 * map.prediction_period_s) + " ms in " +
                    listed(names_of(prediction_messages(map), map)));
  }
  MachineDescription machine = map.machine;
  return {std::move(source), std::move(machine), std::move(map)};
}

/// Waits for the description of the machine on the network; nothing if `stop` is requested before.
/// Publishes the state "waiting" on `node`; the first description that is refused is an event.
std::optional<MachineDescription> introduced(const DdsNode& node,
                                             DdsReader<MachineDescription>& reader,
                                             const std::stop_token& stop, EventLog& events) {
  DdsWriter<MachineStatus> writer(node);
  MachineStatus status;
  status.state = DaemonState::kWaiting;
  writer.write(status);
  MachineDescription machine;
  bool refused = false;
  while (!stop.stop_requested()) {
    if (reader.receive(machine, 0.1)) return machine;
    if (refused || reader.counts().malformed == 0) continue;
    refused = true;
    events.error("source", "",
                 "the description of machine '" + node.place().machine +
                     "' is refused: cycle_s must be " + number(kMinCycle_s) + " to " +
                     number(kMaxCycle_s) + " s, there must be 1 to " + std::to_string(kMaxAxes) +
                     " axes with different names, and a name " + std::string(kUsableNameRule));
  }
  return std::nullopt;
}

void check_axes(const Config& config, const MachineDescription& machine) {
  if (config.axes.empty()) return;
  const MachineDescription wanted = described_by(config);
  for (std::size_t i = 0; i < std::max(wanted.axes.size(), machine.axes.size()); ++i) {
    const std::string there = i < machine.axes.size() ? machine.axes[i].name : "none";
    const std::string here = i < wanted.axes.size() ? wanted.axes[i].name : "none";
    if (there == here) continue;
    throw std::runtime_error("axis " + std::to_string(i + 1) + " is '" + here +
                             "' in the configuration and '" + there + "' in the " +
                             (config.source == SourceKind::kReplay ? "recording" : "CAN mapping"));
  }
  (void)paths_of(config, machine);
}

/// Whether a position wraps around before its bits are used up.
bool goes_round(const MappedSignal& signal) {
  constexpr double kRounding = 0.999;
  return signal.turn > 0.0 &&
         signal.turn < kRounding * std::ldexp(std::abs(signal.signal.scale), signal.signal.length);
}

/// Where the channels of the axes are in the two sources: in the frames of DDS in the order of the
/// configuration, in a mapping by name. Throws std::runtime_error with what the mapping lacks.
std::vector<JoinedAxis> joined_axes(const Config& config, const CanMap& map) {
  std::vector<JoinedAxis> out;
  std::size_t in_frames = 0;
  for (const AxisConfig& axis : config.axes) {
    const auto& mapped = map.machine.axes;
    const auto found = std::find_if(mapped.begin(), mapped.end(),
                                    [&](const auto& one) { return one.name == axis.name; });
    const auto at = static_cast<std::size_t>(found - mapped.begin());
    const bool by_dds = axis.command == SourceKind::kDds || axis.encoder == SourceKind::kDds;
    const auto place = [&](SourceKind kind, CanChannel channel) {
      if (kind == SourceKind::kDds)
        return JoinedAxis::Place{kind == config.source ? 0U : 1U, in_frames};
      const auto refuse = [&](const std::string& why) {
        throw std::runtime_error("axis '" + axis.name + "': " + why);
      };
      if (found == mapped.end()) {
        std::string has;
        for (const auto& one : mapped) has += (has.empty() ? "" : ", ") + one.name;
        refuse("the CAN mapping has no axis of this name; it has " + has);
      }
      if (found->rotary != axis.rotary)
        refuse(std::string("is in ") + (axis.rotary ? "rad" : "m") +
               " in the configuration, and in the other unit in the CAN mapping");
      const auto there = [&](CanChannel one) { return map.find(at, one) != nullptr; };
      if (!there(channel) && !(channel == CanChannel::kCommand && there(CanChannel::kActual) &&
                               there(CanChannel::kFollowingError)))
        refuse("the CAN mapping has no '" + std::string(name_of(channel)) + "' of it");
      const MappedSignal* signal = map.find(at, channel);
      if (axis.command != axis.encoder && signal != nullptr && goes_round(*signal))
        refuse("rollover of '" + std::string(name_of(channel)) +
               "' in the CAN mapping: which turn it is only a command on the same bus can tell");
      return JoinedAxis::Place{kind == config.source ? 0U : 1U, at};
    };
    out.push_back(
        {place(axis.command, CanChannel::kCommand), place(axis.encoder, CanChannel::kActual)});
    if (by_dds) ++in_frames;
  }
  return out;
}

/// The axes of the configuration, each with the unit of the torque that a mapping gives it. Throws
/// std::runtime_error if the configuration has another one.
MachineDescription joined_machine(const Config& config, const CanMap& map,
                                  const std::vector<JoinedAxis>& axes) {
  MachineDescription out = described_by(config);
  for (std::size_t i = 0; i < config.axes.size(); ++i) {
    const std::size_t at = axes[i].actual.axis;
    if (config.axes[i].encoder == SourceKind::kDds || map.find(at, CanChannel::kTorque) == nullptr)
      continue;
    const std::string& unit = map.machine.axes[at].torque_unit;
    if (!out.axes[i].torque_unit.empty() && out.axes[i].torque_unit != unit)
      throw std::runtime_error("axis '" + out.axes[i].name + "': torque_unit is " +
                               out.axes[i].torque_unit + " in the configuration and " + unit +
                               " in the CAN mapping");
    out.axes[i].torque_unit = unit;
  }
  return out;
}

/// Frames by DDS and a mapping of buses as one machine.
MachineInput joining(const Config& config, const DdsNode& node_in, EventLog& events) {
  MachineInput bus = listening(config, events);
  std::vector<JoinedAxis> axes = joined_axes(config, *bus.map);
  MachineDescription machine = joined_machine(config, *bus.map, axes);
  const bool dds_first = config.source == SourceKind::kDds;
  if (!dds_first) machine.cycle_s = bus.machine.cycle_s;
  JoinedSource::Part dds{std::make_unique<DdsSource>(node_in), "dds"},
      can{std::move(bus.source), std::string(name_of(*config.second))};
  if (!dds_first) can.name = name_of(config.source);
  std::array<JoinedSource::Part, 2> parts{std::move(dds), std::move(can)};
  if (!dds_first) std::swap(parts[0], parts[1]);
  events.note(
      "source", "",
      "the cycles are those of " + parts[0].name + ", and " + parts[1].name + " is joined to them");
  // Frames of DDS do not say how long their cycle is.
  const std::array cycles_s{machine.cycle_s, dds_first ? bus.machine.cycle_s : machine.cycle_s};
  return {std::make_unique<JoinedSource>(std::move(parts), std::move(axes), cycles_s),
          std::move(machine), std::nullopt};
}

}  // namespace

std::vector<std::vector<std::size_t>> paths_of(const Config& config,
                                               const MachineDescription& machine) {
  std::map<std::string, std::vector<std::size_t>> named;
  for (std::size_t i = 0; i < config.axes.size(); ++i) {
    const AxisConfig& axis = config.axes[i];
    if (axis.path.empty()) continue;
    if (machine.axes[i].rotary)
      throw std::runtime_error("axis " + axis.name + " is rotary, but path '" + axis.path +
                               "' needs linear axes");
    named[axis.path].push_back(i);
  }
  std::vector<std::vector<std::size_t>> paths;
  for (auto& [name, axes] : named) paths.push_back(std::move(axes));
  if (!paths.empty()) return paths;
  std::vector<std::size_t> linear;
  for (std::size_t i = 0; i < machine.axes.size(); ++i) {
    if (!machine.axes[i].rotary) linear.push_back(i);
  }
  if (linear.size() >= 2 && linear.size() <= kMaxPathAxes) paths.push_back(std::move(linear));
  return paths;
}

std::optional<MachineInput> open_input(const Config& config, const DdsNode& node,
                                       const DdsNode& node_in,
                                       DdsReader<MachineDescription>& descriptions,
                                       const std::stop_token& stop, EventLog& events) {
  MachineInput input;
  if (config.source == SourceKind::kReplay) {
    input = replaying(config, events);
    check_axes(config, input.machine);
    return input;
  }
  if (config.second) {
    input = joining(config, node_in, events);
    (void)paths_of(config, input.machine);
    return input;
  }
  if (config.source == SourceKind::kCan || config.source == SourceKind::kUdp) {
    input = listening(config, events);
    check_axes(config, input.machine);
    return input;
  }
  events.note("source", "",
              "waiting for machine '" + config.machine + "' on DDS domain " +
                  std::to_string(node_in.place().domain));
  if (config.axes.empty()) {
    const std::optional<MachineDescription> machine = introduced(node, descriptions, stop, events);
    if (!machine) return std::nullopt;
    input.machine = *machine;
  } else {
    input.machine = described_by(config);
  }
  input.source = std::make_unique<DdsSource>(node_in);
  return input;
}

std::vector<std::string> input_obstacles(const Config& config) {
  std::vector<std::string> found;
  const auto attempt = [&](const auto& action) {
    try {
      action();
    } catch (const std::exception& error) {
      // The message has one line per problem of a mapping.
      std::istringstream lines(error.what());
      for (std::string line; std::getline(lines, line);) found.push_back(line);
    }
  };
  const auto check_contract = [&](double cycle_s, const CanMap* map) {
    for (const std::string& refusal : offset_contract(config, cycle_s, map).refusals)
      found.push_back("offsets cannot be armed: " + refusal);
  };
  if (config.second) {
    attempt([&] {
      const CanMap map = mapping(config);
      (void)joined_machine(config, map, joined_axes(config, map));
      (void)paths_of(config, described_by(config));
      if (config.ilc.live) check_contract(described_by(config).cycle_s, nullptr);
    });
  } else if (config.source == SourceKind::kCan || config.source == SourceKind::kUdp) {
    attempt([&] {
      const CanMap map = mapping(config);
      check_axes(config, map.machine);
      if (!config.ilc.live) return;
      for (const std::size_t axis : corrected_axes(config)) CanOffset(map, axis);
      check_contract(map.machine.cycle_s, &map);
    });
  } else if (config.source == SourceKind::kDds && config.ilc.live && !config.axes.empty()) {
    check_contract(described_by(config).cycle_s, nullptr);
  }
  if (config.uses(SourceKind::kUdp)) {
    const UdpConfig& udp = config.udp;
    const auto check = [&](const char* key, const auto& action) {
      try {
        action();
      } catch (const std::runtime_error& error) {
        found.push_back(std::string("source.udp.") + key + ": " + error.what());
      }
    };
    check("listen", [&] {
      CanUdp::require_address(udp.listen, true);
      CanUdp::require_known_sender({udp.listen, udp.peer});
    });
    if (!udp.peer.empty()) check("peer", [&] { CanUdp::require_address(udp.peer, false); });
  }
  if (config.source != SourceKind::kReplay) return found;
  std::vector<Replay> recordings;
  for (const std::filesystem::path& file : config.replay.files)
    attempt([&] { recordings.push_back(read_replay(config, file).replay); });
  if (recordings.size() == config.replay.files.size()) {
    attempt([&] {
      check_axes(config, ReplaySource(std::move(recordings), config.replay.speed).machine());
    });
  }
  return found;
}

}  // namespace servotwin::daemon
