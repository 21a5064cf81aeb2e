// The mapping of CAN messages to axes: which bits carry which channel of which axis.
//
// Read from a mapping in TOML (all keys: drivers/README.md), which may refer to .dbc, .eds and .dcf
// files beside it. A decoded position is in m or rad of the axis, with gear, lead and sign:
//   position = sign * (raw * scale + offset) [unit] * lead / (2 pi gear_ratio)
// where the last factor applies to angles of the motor.
// Any thread. Errors: problems with file, line and column, as in the daemon's configuration.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/can/can_signal.h"
#include "drivers/common/config_problem.h"
#include "drivers/common/messages.h"

namespace servotwin {

/// The meaning of a signal for its axis. The first four and the status word come from the drive.
enum class CanChannel : std::uint8_t {
  kCommand,         ///< position demand, 0x6062
  kActual,          ///< position actual value, 0x6064
  kTorque,          ///< torque actual value, 0x6077
  kFollowingError,  ///< 0x60F4: command - actual; the command is computed from it if none is sent
  kStatusWord,      ///< 0x6041
  kTarget,          ///< target position, 0x607A, from the controller to the drive
  kOffset,          ///< position offset, 0x60B0, from this program to the drive
  kControlWord,     ///< 0x6040
  // From this program to a PLC, in messages of their own:
  kPredictedError,   ///< of the tracking error
  kResidual,         ///< measured minus predicted error
  kPredictionValid,  ///< 1: the two are known; else they are sent as 0
  kAlarm,            ///< 1: the residual alarm is raised
};
inline constexpr std::size_t kCanChannels = 12;
[[nodiscard]] std::string_view name_of(CanChannel channel) noexcept;

/// Whether the signal goes to a PLC.
[[nodiscard]] constexpr bool is_prediction(CanChannel channel) noexcept {
  return channel >= CanChannel::kPredictedError;
}

/// The selector of a multiplexed message, which is present only if these bits have this value.
struct CanSelector {
  CanSignal signal;
  std::uint64_t value = 0;
};

struct MappedSignal {
  CanSignal signal;         ///< with scale and offset to the units of the axis
  std::size_t message = 0;  ///< of CanMap::messages
  std::size_t axis = 0;     ///< of CanMap::axes
  CanChannel channel = CanChannel::kCommand;
  double turn = 0.0;   ///< period of a position that wraps around [m | rad]; 0: it does not
  std::string origin;  ///< "object 0x6064:00 of node 1", for error messages
  /// Of an offset: after this time without a new one the drive drops it [s]; infinite: it keeps it;
  /// absent: the mapping does not say.
  std::optional<double> timeout_s{};
};

struct MappedMessage {
  std::size_t bus = 0;
  std::uint32_t id = 0;
  bool extended = false;
  int length = 0;  ///< required number of bytes; with `at_least`, the minimum
  bool at_least = false;
  std::optional<CanSelector> selector;
  std::string name;           ///< "0x181 (node 1, TPDO1)"
  int rpdo = 0;               ///< number of this RPDO of a CANopen node, 1..512; 0: not known
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
  double deadline_s = 0.0;            ///< after the start of a cycle, for its messages
  double prediction_period_s = 0.01;  ///< between two messages to a PLC
  CycleStart start;
  std::vector<std::string> buses;  ///< names of the interfaces, as in logs
  std::vector<MappedMessage> messages;
  std::vector<MappedSignal> signals;
  std::vector<std::string> notes;  ///< oddities in the files that it refers to

  [[nodiscard]] const MappedSignal* find(std::size_t axis, CanChannel channel) const noexcept;
};

/// The messages of a map that carry predictions.
[[nodiscard]] std::vector<std::size_t> prediction_messages(const CanMap& map);

/// What a mapping must have of every axis.
enum class Mapped : std::uint8_t {
  kWholeAxes,  ///< a command, or what it follows from
  kChannels,   ///< any channel: the rest comes from another source
};

struct CheckedCanMap {
  CanMap map;                           ///< to be used only if there are no problems
  std::vector<ConfigProblem> problems;  ///< in the order of the file
};

/// Reads the text of a mapping; `name` is used in messages; files are searched for in `folder`.
[[nodiscard]] CheckedCanMap check_can_map(std::string_view text, const std::string& name,
                                          const std::filesystem::path& folder,
                                          Mapped mapped = Mapped::kWholeAxes);
/// Throws std::runtime_error with all problems, one per line, or why the file cannot be read.
[[nodiscard]] CanMap load_can_map(const std::filesystem::path& file,
                                  Mapped mapped = Mapped::kWholeAxes);

}  // namespace servotwin
