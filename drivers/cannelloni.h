// CAN frames in UDP packets, as cannelloni (version 2) sends them.
//
//   version 2 | operation 0 | sequence | count (2)        then for each frame, big endian
//   id with the flags of <linux/can.h> (4) | length, bit 7: FD (1) | flags (1, FD only) | data
// A frame that asks for data has none. Source: cannelloni, doc/udp_format.md. Any thread; allocates
// nothing, throws nothing.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "drivers/can_frame.h"

namespace servotwin {

/// The frames of one packet, one after the other. The bytes outlive it.
class CannelloniPacket {
 public:
  /// Nothing if the head is that of no such packet.
  [[nodiscard]] static std::optional<CannelloniPacket> parse(
      std::span<const std::uint8_t> bytes) noexcept;

  [[nodiscard]] std::uint8_t sequence() const noexcept { return sequence_; }
  /// False when there is no more, or the rest is damaged.
  bool next(CanFrame& frame) noexcept;
  /// The packet has not what its head and its frames say.
  [[nodiscard]] bool damaged() const noexcept { return damaged_; }

 private:
  std::span<const std::uint8_t> rest_;
  std::uint8_t sequence_ = 0;
  std::uint16_t left_ = 0;
  bool damaged_ = false;
};

/// Writes as many frames as fit into `packet`; how many, and how many bytes they take.
struct CannelloniWritten {
  std::size_t frames = 0, bytes = 0;
};
[[nodiscard]] CannelloniWritten write_cannelloni(std::span<const CanFrame> frames,
                                                 std::uint8_t sequence,
                                                 std::span<std::uint8_t> packet) noexcept;

}  // namespace servotwin
