// One frame of a CAN bus, classic or FD, as received by this host.
//
// Fixed size and trivially copyable. Source: ISO 11898-1; the bits of an error frame's id and data
// are those of <linux/can/error.h>. Any thread; errors: none.
#pragma once

#include <array>
#include <cstdint>
#include <string>

namespace servotwin {

struct CanFrame {
  static constexpr std::size_t kClassicBytes = 8;
  static constexpr std::size_t kMaxBytes = 64;

  std::int64_t time_ns = 0;  ///< kernel's receive stamp [ns since 1970]
  std::uint32_t id = 0;      ///< 11 or 29 bits; of an error frame its classes
  bool extended = false;     ///< the id has 29 bits
  bool remote = false;       ///< remote request; `length` is the requested number of bytes
  bool error = false;        ///< made by the driver of the interface, never on the bus
  bool fd = false;
  bool fast = false;       ///< FD: data at the higher bit rate
  bool passive = false;    ///< FD: its sender was error passive
  bool after_gap = false;  ///< frames before this one are known to have been lost in transport
  std::uint8_t length = 0;
  std::array<std::uint8_t, kMaxBytes> data{};
};

inline constexpr std::uint32_t kStandardIds = 0x800;     ///< number of ids of 11 bits
inline constexpr std::uint32_t kExtendedIds = 1U << 29;  ///< number of ids of 29 bits

/// The smallest possible length of a frame of at least this many bytes: above 8, FD frames have 12,
/// 16, 20, 24, 32, 48 or 64. At most 64.
[[nodiscard]] std::size_t can_length_at_least(std::size_t bytes, bool fd) noexcept;

/// "0x181", or with eight digits where it is extended.
[[nodiscard]] std::string can_id_text(std::uint32_t id, bool extended);

/// The errors in an error frame that concern a receiver.
struct CanErrors {
  bool bus_off = false;             ///< the interface no longer takes part in the bus
  bool restarted = false;           ///< it takes part again
  bool passive = false;             ///< close to bus-off
  bool warning = false;             ///< more than 96 errors
  bool lost_in_controller = false;  ///< the controller's receive buffer overflowed
  bool not_acknowledged = false;    ///< no other node is on the bus, or the cable is open
  bool protocol = false;            ///< damaged bits: cable, termination, bit rate
};
[[nodiscard]] CanErrors can_errors(const CanFrame& frame) noexcept;

}  // namespace servotwin
