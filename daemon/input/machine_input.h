// Opens the configured source of frames (recordings, CAN buses, DDS) and finds out which machine it
// is.
//
// Errors: std::runtime_error if the source cannot be opened or has other axes than the
// configuration. One thread.
#pragma once

#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/config/config.h"
#include "daemon/input/frame_source.h"
#include "daemon/store/event_log.h"
#include "drivers/can/can_map.h"
#include "drivers/common/messages.h"
#include "drivers/dds/dds.h"

namespace servotwin::daemon {

struct MachineInput {
  std::unique_ptr<FrameSource> source;
  MachineDescription machine;
  std::optional<CanMap> map{};  ///< of a machine on CAN
};

/// Opens the configured source. If the configuration names no axes and frames come over DDS, waits
/// for the description of the machine on `descriptions` and publishes the state "waiting" on
/// `node`; returns nothing if `stop` is requested before. `node_in`: DDS node of the frames.
[[nodiscard]] std::optional<MachineInput> open_input(const Config& config, const DdsNode& node,
                                                     const DdsNode& node_in,
                                                     DdsReader<MachineDescription>& descriptions,
                                                     const std::stop_token& stop, EventLog& events);

/// The paths of the machine, each with the indices of its axes: those of the configuration, else
/// one path of all linear axes if there are 2 to kMaxPathAxes of them. Throws std::runtime_error if
/// a rotary axis has a path.
[[nodiscard]] std::vector<std::vector<std::size_t>> paths_of(const Config& config,
                                                             const MachineDescription& machine);

/// Reasons why the source could not be opened, as far as they can be found without opening it:
/// wrong mappings, recordings that cannot be replayed, axes that differ. One line each.
[[nodiscard]] std::vector<std::string> input_obstacles(const Config& config);

}  // namespace servotwin::daemon
