#include "drivers/can/cannelloni.h"

#include <linux/can.h>

#include <algorithm>
#include <cstring>

namespace servotwin {
namespace {

constexpr std::uint8_t kVersion = 2;
constexpr std::uint8_t kData = 0;  // the operation
constexpr std::size_t kHead = 5;
constexpr std::uint8_t kFd = 0x80;

}  // namespace

std::optional<CannelloniPacket> CannelloniPacket::parse(
    std::span<const std::uint8_t> bytes) noexcept {
  if (bytes.size() < kHead || bytes[0] != kVersion || bytes[1] != kData) return std::nullopt;
  CannelloniPacket packet;
  packet.sequence_ = bytes[2];
  packet.left_ = static_cast<std::uint16_t>(bytes[3] << 8 | bytes[4]);
  packet.rest_ = bytes.subspan(kHead);
  return packet;
}

bool CannelloniPacket::next(CanFrame& frame) noexcept {
  if (left_ == 0) {
    damaged_ = damaged_ || !rest_.empty();
    return false;
  }
  const auto refuse = [&] {
    damaged_ = true;
    left_ = 0;
    rest_ = {};
    return false;
  };
  if (rest_.size() < 5) return refuse();
  const std::uint32_t id = std::uint32_t{rest_[0]} << 24 | std::uint32_t{rest_[1]} << 16 |
                           std::uint32_t{rest_[2]} << 8 | rest_[3];
  frame = {};
  frame.fd = (rest_[4] & kFd) != 0;
  const std::size_t length = rest_[4] & 0x7FU;
  rest_ = rest_.subspan(5);
  if (frame.fd) {
    if (rest_.empty()) return refuse();
    frame.fast = (rest_[0] & CANFD_BRS) != 0;
    frame.passive = (rest_[0] & CANFD_ESI) != 0;
    rest_ = rest_.subspan(1);
  }
  frame.error = (id & CAN_ERR_FLAG) != 0;
  frame.extended = !frame.error && (id & CAN_EFF_FLAG) != 0;
  frame.remote = (id & CAN_RTR_FLAG) != 0;
  frame.id = id & (frame.extended || frame.error ? CAN_EFF_MASK : CAN_SFF_MASK);
  const std::size_t bytes = frame.remote ? 0 : length;
  if (length > (frame.fd ? CanFrame::kMaxBytes : CanFrame::kClassicBytes) || rest_.size() < bytes)
    return refuse();
  frame.length = static_cast<std::uint8_t>(length);
  std::copy_n(rest_.begin(), bytes, frame.data.begin());
  rest_ = rest_.subspan(bytes);
  --left_;
  return true;
}

CannelloniWritten write_cannelloni(std::span<const CanFrame> frames, std::uint8_t sequence,
                                   std::span<std::uint8_t> packet) noexcept {
  CannelloniWritten written;
  if (packet.size() < kHead) return written;
  written.bytes = kHead;
  for (const CanFrame& frame : frames) {
    const std::size_t bytes = frame.remote ? 0 : frame.length;
    const std::size_t needed = 5U + (frame.fd ? 1U : 0U) + bytes;
    if (written.bytes + needed > packet.size() || written.frames == 0xFFFF) break;
    const std::uint32_t id = frame.id | (frame.extended ? CAN_EFF_FLAG : 0U) |
                             (frame.remote ? CAN_RTR_FLAG : 0U) | (frame.error ? CAN_ERR_FLAG : 0U);
    std::uint8_t* to = packet.data() + written.bytes;
    for (const int shift : {24, 16, 8, 0}) *to++ = static_cast<std::uint8_t>(id >> shift);
    *to++ = static_cast<std::uint8_t>(frame.length | (frame.fd ? kFd : 0U));
    if (frame.fd)
      *to++ =
          static_cast<std::uint8_t>((frame.fast ? CANFD_BRS : 0) | (frame.passive ? CANFD_ESI : 0));
    std::copy_n(frame.data.begin(), bytes, to);
    written.bytes += needed;
    ++written.frames;
  }
  packet[0] = kVersion;
  packet[1] = kData;
  packet[2] = sequence;
  packet[3] = static_cast<std::uint8_t>(written.frames >> 8);
  packet[4] = static_cast<std::uint8_t>(written.frames);
  return written;
}

}  // namespace servotwin
