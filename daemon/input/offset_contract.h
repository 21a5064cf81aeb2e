// The contract for live offsets with the drives of a machine (docs/decisions/0011): whether
// offsets may be armed, and what must be set in the drives.
//
// A drive must drop an offset that is not renewed, not before validity_s. On CAN the mapping states
// its time-out (offset_timeout_s); over DDS every offset carries its expiry. Any thread; errors:
// none.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "daemon/config/config.h"
#include "drivers/can/can_map.h"

namespace servotwin::daemon {

struct OffsetContract {
  std::vector<std::string> refusals;  ///< why offsets must not be armed, one sentence each
  std::vector<std::string> remarks;   ///< what was permitted by name, one sentence each
  double drive_timeout_s = 0.0;       ///< longest time-out that the mapping states; 0: none

  /// "offsets cannot be armed: ..." with all refusals; empty if there are none.
  [[nodiscard]] std::string refusal() const;
};

/// Indices of the axes that have a correction.
[[nodiscard]] std::vector<std::size_t> corrected_axes(const Config& config);

/// The contract of the corrected axes. `map`: of a machine on CAN with the axes of the
/// configuration, null for others.
[[nodiscard]] OffsetContract offset_contract(const Config& config, double cycle_s,
                                             const CanMap* map);

/// What must be set in the drives of the corrected axes: one line per object, "X: 0x1401:05 = ..".
[[nodiscard]] std::vector<std::string> drive_settings(const Config& config, const CanMap& map);

}  // namespace servotwin::daemon
