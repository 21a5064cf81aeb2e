// Recordings of ROS 2 in MCAP files, which ros2 bag record writes.
//
// A topic is read whose messages name joints (`joint_names` or `name`) and have a position for
// each, by the definition that the file stores with it: those of control_msgs/msg/
// JointTrajectoryControllerState of any generation, sensor_msgs/msg/JointState and the like. Each
// joint is an axis:
//   reference.positions, desired.positions          command [rad]
//   feedback.positions, actual.positions, position  encoder [rad]
//   feedback.effort, actual.effort, effort          torque [Nm]
// ReadOptions::columns names a column TOPIC:FIELD.JOINT, and the unit where the joint is linear:
//   Z.command=/arm/controller_state:reference.positions.lift[m]
// Time is header.stamp, in seconds since the first one; the time of the recorder where that is 0.
// Rows are the messages of one topic. Another topic is joined where its stamps are the same, as
// those of all controllers of one controller manager are. Errors: as
// drivers/recordings/recording_file.h, and those of drivers/recordings/mcap/mcap_file.h. Any
// thread.
#pragma once

#include <filesystem>
#include <string_view>

#include "drivers/recordings/recording_file.h"
#include "twin/sample.h"

namespace servotwin {

/// By the first bytes of a file.
[[nodiscard]] bool is_mcap(std::string_view start) noexcept;
[[nodiscard]] Recording read_mcap(const std::filesystem::path& file, const ReadOptions& options);

}  // namespace servotwin
