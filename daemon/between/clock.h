// The clocks, and stamps of others. Only the daemon asks clocks; twin, identification and diagnosis
// are told the time.
#pragma once

#include <time.h>

#include <cstdint>

namespace servotwin::daemon {

namespace detail {
inline std::int64_t clock_ns(clockid_t clock) noexcept {
  timespec now{};
  clock_gettime(clock, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}
}  // namespace detail

/// Since some moment before the program started [ns]; never goes back.
[[nodiscard]] inline std::int64_t steady_ns() noexcept { return detail::clock_ns(CLOCK_MONOTONIC); }
/// Since 1970 [ns].
[[nodiscard]] inline std::int64_t wall_ns() noexcept { return detail::clock_ns(CLOCK_REALTIME); }

/// From one stamp to another [ns]. A foreign stamp may be anything: the difference wraps instead of
/// overflowing.
[[nodiscard]] constexpr std::int64_t between_ns(std::int64_t from, std::int64_t to) noexcept {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(to) -
                                   static_cast<std::uint64_t>(from));
}

}  // namespace servotwin::daemon
