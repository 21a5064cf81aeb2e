// Which bits of a frame are a number, and back.
//
//   value = raw scale + offset
//
// Bits are numbered as in a DBC file: bit b of byte n is 8 n + b. Little endian (Intel): `start` is
// the lowest bit, and the signal grows towards higher numbers. Big endian (Motorola): `start` is
// the highest bit, and the signal goes on downwards in its byte, then at bit 7 of the next one.
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

/// How many bytes a frame needs for this signal; 0 if there is no such signal: a start, length or
/// coding that cannot be.
[[nodiscard]] int bytes_needed(const CanSignal& signal) noexcept;

/// The bits, in the lower end. The signal must lie in `data`: bytes_needed() <= data.size().
[[nodiscard]] std::uint64_t raw_bits(const CanSignal& signal,
                                     std::span<const std::uint8_t> data) noexcept;
void set_raw_bits(const CanSignal& signal, std::uint64_t raw,
                  std::span<std::uint8_t> data) noexcept;

/// The bits as the number they stand for, before scale and offset; a whole number below 2^53 is
/// exact.
[[nodiscard]] double raw_number(const CanSignal& signal, std::uint64_t raw) noexcept;
/// The same of a signal that is not kFloat, exactly.
[[nodiscard]] std::int64_t raw_integer(const CanSignal& signal, std::uint64_t raw) noexcept;

[[nodiscard]] double decoded(const CanSignal& signal, std::span<const std::uint8_t> data) noexcept;

/// The bits of the nearest value that the signal can carry; false if `value` is outside of its
/// range or not a number, and then `raw` is not touched. `wraps`: the range has no end, values go
/// round.
[[nodiscard]] bool encoded(const CanSignal& signal, double value, bool wraps,
                           std::uint64_t& raw) noexcept;

}  // namespace servotwin
