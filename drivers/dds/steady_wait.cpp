// Waits of Cyclone DDS that do not follow the wall clock.
//
// Up to 0.10, which Debian 12 has, Cyclone computes a time of the wall clock from a length and
// waits for that (eclipse-cyclonedds/cyclonedds issue 1995, changed in pull request 2255). Where
// the clock is set back by an hour meanwhile, its event thread sends neither heartbeat nor lease
// for an hour, and a reader that waits for 20 ms waits for an hour. The definition here comes
// before the C library's for every program that links it; of the libraries that we link only
// Cyclone calls it. See docs/decisions/0008.
#include <errno.h>
#include <pthread.h>
#include <time.h>

#include <cstdint>

extern "C" int pthread_cond_timedwait(pthread_cond_t* condition, pthread_mutex_t* mutex,
                                      const timespec* until) noexcept(false) {
  constexpr std::int64_t kSecond_ns = 1'000'000'000;
  // Before 2001 by the wall clock: a time since the start of the host, from a library that waits as
  // it should.
  constexpr time_t kWall_s = 1'000'000'000;
  if (until->tv_sec > 0 && until->tv_sec < kWall_s)
    return pthread_cond_clockwait(condition, mutex, CLOCK_MONOTONIC, until);
  timespec wall{}, steady{};
  clock_gettime(CLOCK_REALTIME, &wall);
  clock_gettime(CLOCK_MONOTONIC, &steady);
  const std::int64_t left =
      (until->tv_sec - wall.tv_sec) * kSecond_ns + (until->tv_nsec - wall.tv_nsec);
  const std::int64_t end = steady.tv_sec * kSecond_ns + steady.tv_nsec + (left > 0 ? left : 0);
  const timespec when{end / kSecond_ns, end % kSecond_ns};
  return pthread_cond_clockwait(condition, mutex, CLOCK_MONOTONIC, &when);
}
