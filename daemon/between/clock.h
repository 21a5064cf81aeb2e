// The clocks of the host, and differences of time stamps. Only the daemon reads clocks; twin,
// identification and diagnosis get the time as an argument. Any thread; errors: none.
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

/// The clock of steady_ns(), for waits until a time of it. It goes on while the host sleeps, as
/// drives do: an offset that was made before is not young afterwards.
inline constexpr clockid_t kSteadyClock = CLOCK_BOOTTIME;
/// Clock that nobody sets: time since the start of the host [ns].
[[nodiscard]] inline std::int64_t steady_ns() noexcept { return detail::clock_ns(kSteadyClock); }
/// The clock of the service manager, which stands still while the host sleeps [ns].
[[nodiscard]] inline std::int64_t monotonic_ns() noexcept {
  return detail::clock_ns(CLOCK_MONOTONIC);
}
/// Wall clock: time since 1970-01-01 UTC [ns].
[[nodiscard]] inline std::int64_t wall_ns() noexcept { return detail::clock_ns(CLOCK_REALTIME); }

/// Time from one stamp to another [ns]. Stamps from outside may have any value: the difference
/// wraps around instead of overflowing.
[[nodiscard]] constexpr std::int64_t between_ns(std::int64_t from, std::int64_t to) noexcept {
  return static_cast<std::int64_t>(static_cast<std::uint64_t>(to) -
                                   static_cast<std::uint64_t>(from));
}

}  // namespace servotwin::daemon
