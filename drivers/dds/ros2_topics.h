// What a daemon publishes, as topics of ROS 2: rt/NAMESPACE/prediction, status, model and
// diagnosis, with the types of examples/ros2/servotwin_msgs (Cyclone DDS; msgs/servotwin_ros2.idl).
//
// Reliable, so that subscribers with either reliability hear them; no key, no partition, shared
// ownership, as ROS 2 has it. Status, model and diagnosis are kept for late joiners. One thread.
// Errors: the constructor throws std::runtime_error, or std::invalid_argument for a name.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "drivers/common/messages.h"
#include "drivers/dds/dds.h"

namespace servotwin {

/// Whether these are letters, digits and underscores between single slashes, no part of it
/// beginning with a digit: the rule of ROS 2 for names.
[[nodiscard]] bool usable_ros2_name(const std::string& name);

class Ros2Topics {
 public:
  /// `name_space`: what the topics begin with, usable_ros2_name, or empty.
  /// `place`: of ROS 2, without a partition.
  Ros2Topics(const DdsPlace& place, const std::string& name_space);

  /// `axes`: names and kinds, in the order of the prediction; those that are missing have no name.
  void write(const MachinePrediction& prediction, const std::vector<AxisStatus>& axes);
  void write(const MachineStatus& status);
  void write(const ModelAnnouncement& model);
  void write(const DiagnosisAnnouncement& diagnosis);
  /// Messages that could not be sent.
  [[nodiscard]] std::uint64_t failed() const noexcept { return failed_; }

 private:
  void send(const DdsEntity& writer, const void* message);

  DdsNode node_;
  std::string machine_;
  DdsEntity predictions_, statuses_, models_, diagnoses_;
  std::uint64_t failed_ = 0;
};

}  // namespace servotwin
