// CAN frames in UDP packets, as cannelloni (version 2) sends them.
//
//   version 2 | operation 0 | sequence | count (2)        then for each frame, big endian
//   id with the flags of <linux/can.h> (4) | length, bit 7: FD (1) | flags (1, FD only) | data
// A remote request has no data. Source: cannelloni, doc/udp_format.md. Any thread; allocates
// nothing, throws nothing.
#pragma once

#include <cstdint>
#include <optional>
#include <span>

#include "drivers/can/can_frame.h"

namespace servotwin {

/// Reads the frames of one packet one after the other. The bytes must outlive the object.
class CannelloniPacket {
 public:
  /// Nothing if the header is not that of a cannelloni packet.
  [[nodiscard]] static std::optional<CannelloniPacket> parse(
      std::span<const std::uint8_t> bytes) noexcept;

  [[nodiscard]] std::uint8_t sequence() const noexcept { return sequence_; }
  /// Returns false if there is no further frame or the rest is damaged.
  bool next(CanFrame& frame) noexcept;
  /// Whether the packet is shorter or longer than its header and frames require.
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
