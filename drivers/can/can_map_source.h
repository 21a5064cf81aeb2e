// The sources of the signals of a mapping: written by hand, from a .dbc, or from the PDOs of a
// CANopen node. A part of drivers/can/can_map.h. One thread. Errors: std::runtime_error with what
// is missing, where, and what is available instead.
#pragma once

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "drivers/can/can_map.h"
#include "drivers/can/dbc.h"
#include "drivers/can/eds.h"
#include "drivers/common/toml_section.h"

namespace servotwin {

/// The keys of an axis that apply to all of its signals.
struct SignalDefaults {
  std::size_t bus = 0;
  int node = 0;  ///< 0: none
  std::string position_unit, torque_unit;
  double rollover = 0.0;  ///< steps of the raw value; 0: the full range of its bits
};

/// The keys of one signal.
struct SignalKeys {
  enum class Kind { kHand, kDbc, kObject } kind = Kind::kHand;
  bool failed = false;  ///< the keys have an error, which has been reported
  std::size_t bus = 0;
  MappedMessage message;  // by hand
  CanSignal signal;       // by hand
  std::string dbc_message, dbc_signal;
  int node = 0;
  int object = 0, sub = 0;
  std::string unit;
  double rollover = 0.0;
};

[[nodiscard]] SignalKeys read_signal_keys(Section& section, const SignalDefaults& defaults,
                                          int default_object);

/// A signal as its source describes it, and the message that carries it.
struct SourceSignal {
  CanSignal signal;
  MappedMessage message;
  std::string unit;    ///< unit given by the source; empty: none
  int object = 0;      ///< 0: it is not an object of a drive
  std::string origin;  ///< for messages
};

class SignalSources {
 public:
  /// Files are searched for in `folder`; oddities in them are added to `notes`.
  SignalSources(std::filesystem::path folder, std::vector<std::string>& notes)
      : folder_(std::move(folder)), notes_(notes) {}

  void add_dbc(std::size_t bus, const std::string& file);
  /// `id` 0: that of the DCF. Returns the id.
  int add_node(std::size_t bus, int id, const std::string& file);
  /// Replaces the mapping of a PDO in the file, if the controller maps these objects, in this
  /// order, when it starts. `can_id`: nothing if the id in the file is valid.
  void map_pdo(std::size_t bus, int id, bool transmit, int number,
               const std::optional<std::uint32_t>& can_id,
               const std::vector<std::pair<int, int>>& objects);
  [[nodiscard]] bool has_node(std::size_t bus, int id) const { return nodes_.contains({bus, id}); }
  /// "; drive.eds maps TPDO1 (0x181): ...", for messages.
  [[nodiscard]] std::string pdos_of(std::size_t bus, int id) const;

  [[nodiscard]] SourceSignal resolve(const SignalKeys& keys, bool to_drive) const;
  /// The object in a PDO that is switched on; none if no PDO has it.
  [[nodiscard]] std::optional<SourceSignal> find_object(std::size_t bus, int id, int object,
                                                        int sub, bool to_drive) const;

 private:
  struct Node {
    std::string file;
    EdsDevice device;
  };
  [[nodiscard]] SourceSignal from_dbc(const SignalKeys& keys) const;
  [[nodiscard]] SourceSignal from_node(const SignalKeys& keys, bool to_drive) const;

  std::filesystem::path folder_;
  std::vector<std::string>& notes_;
  std::map<std::size_t, std::pair<std::string, Dbc>> dbcs_;  // by bus
  std::map<std::pair<std::size_t, int>, Node> nodes_;        // by bus and id
};

}  // namespace servotwin
