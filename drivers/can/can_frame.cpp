#include "drivers/can/can_frame.h"

#include <linux/can/error.h>

#include <cstdio>

namespace servotwin {

std::size_t can_length_at_least(std::size_t bytes, bool fd) noexcept {
  if (bytes <= CanFrame::kClassicBytes) return bytes;
  if (!fd) return CanFrame::kClassicBytes;
  for (const std::size_t length : {12U, 16U, 20U, 24U, 32U, 48U}) {
    if (bytes <= length) return length;
  }
  return CanFrame::kMaxBytes;
}

std::string can_id_text(std::uint32_t id, bool extended) {
  char text[16];
  std::snprintf(text, sizeof text, extended ? "0x%08X" : "0x%03X", id);
  return text;
}

CanErrors can_errors(const CanFrame& frame) noexcept {
  CanErrors errors;
  if (!frame.error) return errors;
  errors.bus_off = (frame.id & CAN_ERR_BUSOFF) != 0;
  errors.restarted = (frame.id & CAN_ERR_RESTARTED) != 0;
  errors.not_acknowledged = (frame.id & CAN_ERR_ACK) != 0;
  errors.protocol = (frame.id & (CAN_ERR_PROT | CAN_ERR_BUSERROR)) != 0;
  if ((frame.id & CAN_ERR_CRTL) != 0) {
    const std::uint8_t controller = frame.data[1];
    errors.lost_in_controller = (controller & CAN_ERR_CRTL_RX_OVERFLOW) != 0;
    errors.warning = (controller & (CAN_ERR_CRTL_RX_WARNING | CAN_ERR_CRTL_TX_WARNING)) != 0;
    errors.passive = (controller & (CAN_ERR_CRTL_RX_PASSIVE | CAN_ERR_CRTL_TX_PASSIVE)) != 0;
  }
  return errors;
}

}  // namespace servotwin
