#include "drivers/can/can_signal.h"

#include <algorithm>
#include <bit>
#include <cmath>

namespace servotwin {
namespace {

constexpr std::uint64_t mask_of(int bits) noexcept {
  return bits >= 64 ? ~std::uint64_t{0} : (std::uint64_t{1} << bits) - 1;
}

/// The signal byte by byte, from its lowest bits (little endian) or its highest (big endian):
/// calls use(byte, lowest bit of it in that byte, how many, how many came before).
template <class Use>
void for_each_piece(const CanSignal& signal, Use&& use) noexcept {
  int byte = signal.start / 8;
  int bit = signal.start % 8;
  const bool little = signal.order == ByteOrder::kLittle;
  for (int done = 0; done < signal.length;) {
    const int take = std::min(little ? 8 - bit : bit + 1, signal.length - done);
    use(static_cast<std::size_t>(byte), little ? bit : bit + 1 - take, take, done);
    done += take;
    ++byte;
    bit = little ? 0 : 7;
  }
}

}  // namespace

int bytes_needed(const CanSignal& signal) noexcept {
  const bool real = signal.start >= 0 && signal.start < 8 * 64 && signal.length >= 1 &&
                    signal.length <= 64 &&
                    (signal.coding != Coding::kFloat || signal.length == 32 || signal.length == 64);
  if (!real) return 0;
  int last = 0;
  for_each_piece(signal,
                 [&](std::size_t byte, int, int, int) { last = static_cast<int>(byte) + 1; });
  return last <= 64 ? last : 0;
}

std::uint64_t raw_bits(const CanSignal& signal, std::span<const std::uint8_t> data) noexcept {
  std::uint64_t raw = 0;
  for_each_piece(signal, [&](std::size_t byte, int bit, int count, int done) {
    const std::uint64_t piece = (std::uint64_t{data[byte]} >> bit) & mask_of(count);
    raw = signal.order == ByteOrder::kLittle ? raw | piece << done : raw << count | piece;
  });
  return raw;
}

void set_raw_bits(const CanSignal& signal, std::uint64_t raw,
                  std::span<std::uint8_t> data) noexcept {
  for_each_piece(signal, [&](std::size_t byte, int bit, int count, int done) {
    const int shift = signal.order == ByteOrder::kLittle ? done : signal.length - done - count;
    const auto kept = data[byte] & ~(mask_of(count) << bit);
    data[byte] = static_cast<std::uint8_t>(kept | ((raw >> shift) & mask_of(count)) << bit);
  });
}

std::int64_t raw_integer(const CanSignal& signal, std::uint64_t raw) noexcept {
  if (signal.coding == Coding::kSigned && signal.length < 64 &&
      (raw >> (signal.length - 1) & 1) != 0) {
    raw |= ~mask_of(signal.length);
  }
  return static_cast<std::int64_t>(raw);
}

double raw_number(const CanSignal& signal, std::uint64_t raw) noexcept {
  if (signal.coding == Coding::kFloat) {
    return signal.length == 32
               ? static_cast<double>(std::bit_cast<float>(static_cast<std::uint32_t>(raw)))
               : std::bit_cast<double>(raw);
  }
  if (signal.coding == Coding::kUnsigned) return static_cast<double>(raw);
  return static_cast<double>(raw_integer(signal, raw));
}

double decoded(const CanSignal& signal, std::span<const std::uint8_t> data) noexcept {
  return raw_number(signal, raw_bits(signal, data)) * signal.scale + signal.offset;
}

bool encoded(const CanSignal& signal, double value, bool wraps, std::uint64_t& raw) noexcept {
  const double number = (value - signal.offset) / signal.scale;
  if (!std::isfinite(number)) return false;
  if (signal.coding == Coding::kFloat) {
    if (signal.length == 64) {
      raw = std::bit_cast<std::uint64_t>(number);
      return true;
    }
    const auto narrow = static_cast<float>(number);
    if (!std::isfinite(narrow)) return false;
    raw = std::bit_cast<std::uint32_t>(narrow);
    return true;
  }
  const double whole = std::nearbyint(number);
  // Not beyond what the conversion to 64 bits can take.
  constexpr double kLimit = 9.2e18;
  if (std::abs(whole) > kLimit) return false;
  if (!wraps) {
    const bool is_signed = signal.coding == Coding::kSigned;
    const double top = std::ldexp(1.0, signal.length - (is_signed ? 1 : 0));
    if (whole >= top || whole < (is_signed ? -top : 0.0)) return false;
  }
  raw = static_cast<std::uint64_t>(static_cast<std::int64_t>(whole)) & mask_of(signal.length);
  return true;
}

}  // namespace servotwin
