// What the messages on the buses of a machine mean: which bits are which channel of which axis.
//
// Read from a mapping in TOML (all keys: drivers/README.md), which may refer to .dbc, .eds and .dcf
// files beside it. A decoded position is in m or rad of the axis, with gear, lead and sign:
//   position = (raw scale + offset) [unit] . lead / (2 pi gear_ratio)     from the motor's angle
// Any thread. Errors: problems with file, line and column as of the daemon's configuration.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/can_signal.h"
#include "drivers/config_problem.h"
#include "drivers/messages.h"

namespace servotwin {

/// What a signal is to its axis. From the drive: the first four and its status word.
enum class CanChannel : std::uint8_t {
  kCommand,         ///< position demand, 0x6062
  kActual,          ///< position actual value, 0x6064
  kTorque,          ///< torque actual value, 0x6077
  kFollowingError,  ///< 0x60F4: command - actual; gives the command where none is sent
  kStatusWord,      ///< 0x6041
  kTarget,          ///< target position, 0x607A, from the controller to the drive
  kOffset,          ///< position offset, 0x60B0, from us to the drive
  kControlWord,     ///< 0x6040
};
inline constexpr std::size_t kCanChannels = 8;
[[nodiscard]] std::string_view name_of(CanChannel channel) noexcept;

/// A multiplexed message: it is this one only where these bits have this value.
struct CanSelector {
  CanSignal signal;
  std::uint64_t value = 0;
};

struct MappedSignal {
  CanSignal signal;         ///< with scale and offset to the units of the axis
  std::size_t message = 0;  ///< of CanMap::messages
  std::size_t axis = 0;     ///< of CanMap::axes
  CanChannel channel = CanChannel::kCommand;
  double turn = 0.0;   ///< after which a position goes round [m | rad]; 0: it never does
  std::string origin;  ///< "object 0x6064:00 of node 1", for messages
};

struct MappedMessage {
  std::size_t bus = 0;
  std::uint32_t id = 0;
  bool extended = false;
  int length = 0;  ///< bytes it must have; with `at_least`, or more
  bool at_least = false;
  std::optional<CanSelector> selector;
  std::string name;           ///< "0x181 (node 1, TPDO1)"
  bool from_machine = false;  ///< carries command, actual, torque or following error
};

/// Which message begins a cycle.
struct CycleStart {
  std::size_t bus = 0;
  std::uint32_t id = 0x80;
  bool extended = false;
};

struct CanMap {
  MachineDescription machine;
  double deadline_s = 0.0;  ///< after a cycle's start, until when its messages may come
  CycleStart start;
  std::vector<std::string> buses;  ///< the interfaces' names, as in logs
  std::vector<MappedMessage> messages;
  std::vector<MappedSignal> signals;
  std::vector<std::string> notes;  ///< what was odd in the files that it refers to

  [[nodiscard]] const MappedSignal* find(std::size_t axis, CanChannel channel) const noexcept;
};

struct CheckedCanMap {
  CanMap map;                           ///< to be used only if there are no problems
  std::vector<ConfigProblem> problems;  ///< in the order of the file
};

/// Reads the text of a mapping; `name` stands in messages, and files are sought in `folder`.
[[nodiscard]] CheckedCanMap check_can_map(std::string_view text, const std::string& name,
                                          const std::filesystem::path& folder);
/// Throws std::runtime_error with all problems, one per line, or why the file cannot be read.
[[nodiscard]] CanMap load_can_map(const std::filesystem::path& file);

}  // namespace servotwin
