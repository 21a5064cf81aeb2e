// Where the frames come from, and of what machine: recordings, CAN buses, the network.
//
// Errors: std::runtime_error where the source cannot be opened or says another machine than the
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
#include "drivers/dds.h"
#include "drivers/messages.h"

namespace servotwin::daemon {

struct MachineInput {
  std::unique_ptr<FrameSource> source;
  MachineDescription machine;
};

/// Opens the source that is configured. Where the machine is to say itself who it is, waits for
/// that on `descriptions`, and says on `node` that it does; nothing if asked to stop before.
/// `node_in`: where the frames are, if they come over DDS.
[[nodiscard]] std::optional<MachineInput> open_input(const Config& config, const DdsNode& node,
                                                     const DdsNode& node_in,
                                                     DdsReader<MachineDescription>& descriptions,
                                                     const std::stop_token& stop, EventLog& events);

/// The axes that draw a path, as the configuration says; else the linear ones draw one. Of more
/// than a path can have it is not known which.
[[nodiscard]] std::vector<std::vector<std::size_t>> paths_of(const Config& config,
                                                             const MachineDescription& machine);

/// Why the source could not be opened, as far as that can be told without opening it: mappings that
/// are wrong, recordings that cannot be replayed, axes that are others. One line each.
[[nodiscard]] std::vector<std::string> input_obstacles(const Config& config);

}  // namespace servotwin::daemon
