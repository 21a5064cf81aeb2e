// Messages of ROS 2: the text that defines them ("ros2msg"), and their bytes (CDR) by that text.
//
//   std_msgs/Header header
//   string[] name
//   float64[] position
//   ====..
//   MSG: std_msgs/Header
// Constants and default values are not part of the bytes. Errors: std::runtime_error that says what
// is wrong with the definition or the message, for a caller that says of which. Any thread.
// Sources: ROS 2, "Interfaces"; OMG DDS-XTypes 1.3, 7.4.1 (XCDR1), RTPS 2.5, 10 (its head).
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace servotwin {

/// A field of a message, with the messages in it resolved.
struct RosField {
  enum class Kind { kUnsigned, kSigned, kFloat, kText, kMessage };
  enum class Repeats { kNever, kFixed, kSequence };

  std::string path;  ///< from the outermost message: "reference.positions"
  Kind kind = Kind::kMessage;
  std::uint32_t bytes = 0;  ///< of one number
  Repeats repeats = Repeats::kNever;
  std::uint32_t count = 1;       ///< of kFixed
  std::vector<RosField> fields;  ///< of kMessage
  int slot = -1;                 ///< where decode_cdr puts its values; -1: it skips them
};

/// The message `type`, as "sensor_msgs/msg/JointState". The text begins with its definition; those
/// of the messages in it follow.
[[nodiscard]] RosField parse_ros_definition(std::string_view type, std::string_view text);

/// The values of the fields with a slot, by slot. Those of a field that is repeated, or is in a
/// message that is, follow each other.
struct RosValues {
  std::vector<std::vector<double>> numbers;
  std::vector<std::vector<std::string>> texts;
};

/// Reads the fields of a message that have a slot into `values`, whose vectors have been sized by
/// the caller.
void decode_cdr(const RosField& message, std::string_view bytes, RosValues& values);

}  // namespace servotwin
