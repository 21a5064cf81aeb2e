// Gathers the messages of an MCAP file that name joints, one series of values per joint.
// Errors: std::runtime_error with the file and the topic. One thread at a time.
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace servotwin {

/// A field with a number per joint.
struct JointField {
  std::string path;     ///< "reference.positions"
  std::string channel;  ///< "command", "actual", "torque"; empty if it is none of an axis
  std::string unit;     ///< "[rad]", "[Nm]"
};

/// The messages of a topic that have the same joints: a topic may have several publishers.
struct JointSet {
  std::string topic, type;
  std::vector<JointField> fields;
  std::vector<std::string> joints;          ///< in the order of the first message
  std::vector<std::uint64_t> time_ns;       ///< of each row, in order
  std::vector<std::vector<double>> values;  ///< [field * joints.size() + joint][row]

  [[nodiscard]] const std::vector<double>& of(std::size_t field, std::size_t joint) const {
    return values[field * joints.size() + joint];
  }
  [[nodiscard]] std::string title() const { return topic + " (" + type + ")"; }
};

struct JointSets {
  std::vector<JointSet> sets;      ///< in the order of the file; none is empty
  std::vector<std::string> notes;  ///< what was repaired or is missing
};

/// Throws if there is no such message, with the topics that are there.
[[nodiscard]] JointSets read_joint_sets(const std::filesystem::path& file);

}  // namespace servotwin
