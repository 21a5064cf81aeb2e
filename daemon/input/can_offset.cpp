#include "daemon/input/can_offset.h"

#include <stdexcept>

namespace servotwin::daemon {
namespace {

std::size_t message_of(const CanMap& map, std::size_t axis) {
  const std::string& name = map.machine.axes.at(axis).name;
  const MappedSignal* offset = map.find(axis, CanChannel::kOffset);
  if (offset == nullptr) {
    throw std::runtime_error("axis " + name +
                             " has no offset in the CAN mapping: map object 0x60B0 into an RPDO of "
                             "the drive");
  }
  const MappedMessage& message = map.messages[offset->message];
  if (8 * message.length != offset->signal.length) {
    throw std::runtime_error(message.name + ": carries the offset of axis " + name +
                             " and more, which would be overwritten with 0: map object 0x60B0 "
                             "alone into an RPDO");
  }
  return offset->message;
}

}  // namespace

CanOffset::CanOffset(const CanMap& map, std::size_t axis)
    : encoder_(map), axis_(axis), message_(message_of(map, axis)) {}

bool CanOffset::send(const AxisOffset& offset, CanBus& bus) noexcept {
  if (!offset.send) return false;
  if (!encoder_.set(axis_, CanChannel::kOffset, offset.offset)) {
    ++not_carried_;
    return false;
  }
  return bus.send({&encoder_.frame(message_), 1}) == 1;
}

}  // namespace servotwin::daemon
