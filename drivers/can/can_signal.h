// Conversion between bits of a frame and a number.
//
//   value = raw scale + offset
//
// Bits are numbered as in a DBC file: bit b of byte n is 8 n + b. Little endian (Intel): `start` is
// the lowest bit, and the signal grows towards higher numbers. Big endian (Motorola): `start` is
// the highest bit, and the signal continues downwards in its byte, then at bit 7 of the next byte.
// Any thread; allocates nothing, throws nothing.
#pragma once

#include <cstdint>
#include <span>

namespace servotwin {

enum class ByteOrder : std::uint8_t { kLittle, kBig };
enum class Coding : std::uint8_t {
  kUnsigned,
  kSigned,
  kFloat
};  ///< kFloat: IEEE 754, 32 or 64 bits

struct CanSignal {
  int start = 0;
  int length = 0;  ///< 1..64
  ByteOrder order = ByteOrder::kLittle;
  Coding coding = Coding::kUnsigned;
  double scale = 1.0;
  double offset = 0.0;
};

/// Number of bytes that a frame needs for this signal; 0 if its start, length or coding is invalid.
[[nodiscard]] int bytes_needed(const CanSignal& signal) noexcept;

/// The bits, right-aligned. The signal must lie within `data`: bytes_needed() <= data.size().
[[nodiscard]] std::uint64_t raw_bits(const CanSignal& signal,
                                     std::span<const std::uint8_t> data) noexcept;
void set_raw_bits(const CanSignal& signal, std::uint64_t raw,
                  std::span<std::uint8_t> data) noexcept;

/// The number that the bits represent, before scale and offset; whole numbers below 2^53 are exact.
[[nodiscard]] double raw_number(const CanSignal& signal, std::uint64_t raw) noexcept;
/// The same for a signal that is not kFloat, exact for all values.
[[nodiscard]] std::int64_t raw_integer(const CanSignal& signal, std::uint64_t raw) noexcept;

[[nodiscard]] double decoded(const CanSignal& signal, std::span<const std::uint8_t> data) noexcept;

/// The bits of the nearest value that the signal can carry; false if `value` is outside of its
/// range or not a number, and then `raw` is not touched. `wraps`: values outside of the range wrap
/// around.
[[nodiscard]] bool encoded(const CanSignal& signal, double value, bool wraps,
                           std::uint64_t& raw) noexcept;

}  // namespace servotwin
