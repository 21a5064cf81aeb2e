// The counters of the buses of a machine, and their changes as text. Any thread; errors: none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/can/can_map.h"
#include "drivers/common/messages.h"

namespace servotwin {

struct CanMessageCounts {
  std::uint64_t received = 0;
  std::uint64_t late = 0;          ///< came after the deadline of their cycle; not used
  std::uint64_t missing = 0;       ///< cycles in which it was not received
  std::uint64_t repeated = 0;      ///< a second time in a cycle; not used
  std::uint64_t wrong_length = 0;  ///< not used
  std::uint64_t silences = 0;      ///< how often it was missing for many cycles in a row
  bool silent = false;             ///< it is missing now
};

struct CanTrafficCounts {
  std::uint64_t frames = 0;
  std::uint64_t unexpected = 0;  ///< of ids that the mapping does not have
  std::uint64_t error_frames = 0, bus_off = 0, restarted = 0, passive = 0, lost_in_controller = 0,
                not_acknowledged = 0, protocol = 0;
};

struct CanId {
  std::size_t bus = 0;
  std::uint32_t id = 0;
  bool extended = false;
};

struct CanCounts {
  static constexpr std::size_t kUnexpectedIds = 32;  ///< number of ids that are listed
  std::uint64_t cycles = 0;
  std::uint64_t incomplete = 0;            ///< cycles without all of their messages
  std::vector<CanMessageCounts> messages;  ///< as CanMap::messages
  std::vector<CanTrafficCounts> buses;     ///< as CanMap::buses
  std::vector<CanId> unexpected;           ///< ids, in the order received
};

/// The events between the counts `before` and `now` of the same `map`, one line each; none if there
/// was no problem.
[[nodiscard]] std::vector<SourceNews> happened(const CanMap& map, const CanCounts& before,
                                               const CanCounts& now);

}  // namespace servotwin
