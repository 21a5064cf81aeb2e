// A histogram of durations with fixed bins: one thread fills it, any thread reads it.
//
// Durations in ns up to 2^40 ns, eight bins per octave: a quantile is at most 12.5 % above the true
// one. `add` is wait-free and allocates nothing; one writer thread. Errors: none.
#pragma once

#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>

#include "twin/sample.h"

namespace servotwin::daemon {

class Histogram {
 public:
  void add(std::int64_t ns) noexcept {
    const std::uint64_t value = ns > 0 ? static_cast<std::uint64_t>(ns) : 0;
    bump(bins_[bin_of(value)]);
    // relaxed throughout: figures for display that order no other data; one thread writes.
    sum_.store(sum_.load(std::memory_order_relaxed) + value, std::memory_order_relaxed);
    if (value > max_.load(std::memory_order_relaxed)) max_.store(value, std::memory_order_relaxed);
  }

  /// The quantile `q` (0..1) of all values [s]: the upper end of the bin that contains it; NaN if
  /// there are no values.
  [[nodiscard]] double quantile_s(double q) const noexcept {
    std::uint64_t count = 0;
    for (const auto& bin : bins_) count += bin.load(std::memory_order_relaxed);
    if (count == 0) return kAbsent;
    const auto wanted = static_cast<double>(count) * q;
    std::uint64_t seen = 0;
    for (std::size_t i = 0; i < kBins; ++i) {
      seen += bins_[i].load(std::memory_order_relaxed);
      if (static_cast<double>(seen) >= wanted) return static_cast<double>(end_of(i)) * 1e-9;
    }
    return max_s();
  }
  /// Number of values below 2^`octave` ns, for `octave` >= kBits. Exact, because a bin ends there.
  [[nodiscard]] std::uint64_t below_octave(int octave) const noexcept {
    const std::size_t end = bin_of(std::uint64_t{1} << octave);
    std::uint64_t seen = 0;
    for (std::size_t i = 0; i < end; ++i) seen += bins_[i].load(std::memory_order_relaxed);
    return seen;
  }
  [[nodiscard]] std::uint64_t count() const noexcept {
    std::uint64_t seen = 0;
    for (const auto& bin : bins_) seen += bin.load(std::memory_order_relaxed);
    return seen;
  }
  [[nodiscard]] double sum_s() const noexcept {
    return static_cast<double>(sum_.load(std::memory_order_relaxed)) * 1e-9;
  }
  [[nodiscard]] double max_s() const noexcept {
    return static_cast<double>(max_.load(std::memory_order_relaxed)) * 1e-9;
  }

 private:
  static constexpr int kBits = 3;  // bins per octave: 2^kBits
  static constexpr int kOctaves = 40;
  static constexpr std::size_t kBins = (kOctaves + 1) << kBits;

  // Below 2^kBits every value has its bin; above, the kBits after the leading one choose it.
  static std::size_t bin_of(std::uint64_t value) noexcept {
    if (value < (1U << kBits)) return static_cast<std::size_t>(value);
    const int shift = static_cast<int>(std::bit_width(value)) - 1 - kBits;
    const std::size_t bin =
        (static_cast<std::size_t>(shift) << kBits) + static_cast<std::size_t>(value >> shift);
    return bin < kBins ? bin : kBins - 1;
  }
  static std::uint64_t end_of(std::size_t bin) noexcept {
    if (bin < (1U << kBits)) return bin;
    const int shift = static_cast<int>(bin >> kBits) - 1;
    return (((bin & ((1U << kBits) - 1)) | (1U << kBits)) + 1ULL) << shift;
  }
  static void bump(std::atomic<std::uint64_t>& counter) noexcept {
    counter.store(counter.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
  }

  std::array<std::atomic<std::uint64_t>, kBins> bins_{};
  std::atomic<std::uint64_t> max_{0};
  std::atomic<std::uint64_t> sum_{0};  // [ns]; overflows after 584 years
};

}  // namespace servotwin::daemon
