// One frame of a CAN bus, classic or FD, as it was seen by this host.
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
  bool remote = false;       ///< asks for data; `length` is what it asks for
  bool error = false;        ///< made by the driver of the interface, never on the wire
  bool fd = false;
  bool fast = false;       ///< FD: the data went at the higher bit rate
  bool passive = false;    ///< FD: its sender was error passive
  bool after_gap = false;  ///< frames before this one are known to be lost on the way here
  std::uint8_t length = 0;
  std::array<std::uint8_t, kMaxBytes> data{};
};

inline constexpr std::uint32_t kStandardIds = 0x800;     ///< how many ids of 11 bits there are
inline constexpr std::uint32_t kExtendedIds = 1U << 29;  ///< and of 29 bits

/// The nearest length that a frame can have and that is not shorter: FD knows 12, 16, 20, 24, 32,
/// 48, 64 beyond 8. Nothing is longer than 64.
[[nodiscard]] std::size_t can_length_at_least(std::size_t bytes, bool fd) noexcept;

/// "0x181", or with eight digits where it is extended.
[[nodiscard]] std::string can_id_text(std::uint32_t id, bool extended);

/// What an error frame tells, of what matters to a listener.
struct CanErrors {
  bool bus_off = false;             ///< the interface does not take part any more
  bool restarted = false;           ///< it does again
  bool passive = false;             ///< close to bus-off
  bool warning = false;             ///< more than 96 errors
  bool lost_in_controller = false;  ///< the controller's receive buffer ran over
  bool not_acknowledged = false;    ///< nobody else listens, or the cable is open
  bool protocol = false;            ///< damaged bits: cable, termination, bit rate
};
[[nodiscard]] CanErrors can_errors(const CanFrame& frame) noexcept;

}  // namespace servotwin
