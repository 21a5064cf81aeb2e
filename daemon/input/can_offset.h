// Sends live corrections to a drive: position offsets (object 0x60B0) in a receive PDO, behind the
// gate.
//
// Only offsets that the gate lets pass are sent. The drive must drop an offset that is not renewed.
// An RPDO does not expire by itself: at the end of a correction the gate fades the offset to 0. One
// thread; send() allocates nothing and throws nothing. Source: CiA 402-2, ilc/gate.h.
#pragma once

#include <cstdint>

#include "drivers/can/can_bus.h"
#include "drivers/can/can_encoder.h"
#include "drivers/common/messages.h"

namespace servotwin::daemon {

class CanOffset {
 public:
  /// Throws std::runtime_error if the mapping has no offset of this axis, or if its message carries
  /// anything else: that would be overwritten with 0.
  CanOffset(const CanMap& map, std::size_t axis);

  /// True if the offset was sent; false if the gate does not let it pass, if it does not fit into
  /// the bits of its signal (counted) or if the bus did not accept it.
  bool send(const AxisOffset& offset, CanBus& bus) noexcept;
  [[nodiscard]] std::uint64_t not_carried() const noexcept { return not_carried_; }
  [[nodiscard]] const CanFrame& frame() const noexcept { return encoder_.frame(message_); }

 private:
  CanEncoder encoder_;
  std::size_t axis_;
  std::size_t message_;
  std::uint64_t not_carried_ = 0;
};

}  // namespace servotwin::daemon
