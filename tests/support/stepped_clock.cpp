// A wall clock that somebody sets, for a program that is started with this library preloaded: the
// file named by STEPPED_CLOCK holds what is added to it [ns], as eight bytes that may change at any
// time. A test cannot set the clock of the host it runs on; here ends what is real.
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>

namespace {

constexpr std::int64_t kSecond_ns = 1'000'000'000;

/// The added time; nullptr if there is no such file, and the clock is then unchanged.
const volatile std::int64_t* added() {
  static const auto* const mapped = [] {
    const char* file = std::getenv("STEPPED_CLOCK");
    const int descriptor = file == nullptr ? -1 : open(file, O_RDONLY | O_CLOEXEC);
    void* at = mmap(nullptr, sizeof(std::int64_t), PROT_READ, MAP_SHARED, descriptor, 0);
    return at == MAP_FAILED ? nullptr : static_cast<const volatile std::int64_t*>(at);
  }();
  return mapped;
}

std::int64_t ns_of(const timespec& time) { return time.tv_sec * kSecond_ns + time.tv_nsec; }
timespec timespec_of(std::int64_t ns) { return {ns / kSecond_ns, ns % kSecond_ns}; }

}  // namespace

extern "C" {

int clock_gettime(clockid_t clock, timespec* now) noexcept {
  const auto status = static_cast<int>(syscall(SYS_clock_gettime, clock, now));
  if (status == 0 && (clock == CLOCK_REALTIME || clock == CLOCK_REALTIME_COARSE) &&
      added() != nullptr) {
    *now = timespec_of(ns_of(*now) + *added());
  }
  return status;
}

int gettimeofday(timeval* now, void*) noexcept {
  timespec precise{};
  const int status = clock_gettime(CLOCK_REALTIME, &precise);
  *now = {precise.tv_sec, precise.tv_nsec / 1000};
  return status;
}

time_t time(time_t* now) noexcept {
  timespec precise{};
  (void)clock_gettime(CLOCK_REALTIME, &precise);
  if (now != nullptr) *now = precise.tv_sec;
  return precise.tv_sec;
}
/// A wait until a time of the wall clock ends when the stepped clock reaches it, as in the kernel:
/// an hour later or more if the clock is set back meanwhile.
int pthread_cond_timedwait(pthread_cond_t* condition, pthread_mutex_t* mutex,
                           const timespec* until) {
  constexpr std::int64_t kLook_ns = 10'000'000;
  while (true) {
    timespec wall{}, steady{};
    (void)clock_gettime(CLOCK_REALTIME, &wall);
    (void)clock_gettime(CLOCK_MONOTONIC, &steady);
    const std::int64_t left = ns_of(*until) - ns_of(wall);
    if (left <= 0) return ETIMEDOUT;
    const timespec look = timespec_of(ns_of(steady) + (left < kLook_ns ? left : kLook_ns));
    const int status = pthread_cond_clockwait(condition, mutex, CLOCK_MONOTONIC, &look);
    if (status != ETIMEDOUT) return status;
  }
}
/// The kernel's stamps of what came are of the same clock.
int recvmmsg(int socket, mmsghdr* messages, unsigned most, int flags, timespec* timeout) {
  const auto count =
      static_cast<int>(syscall(SYS_recvmmsg, socket, messages, most, flags, timeout));
  for (int i = 0; i < count && added() != nullptr; ++i) {
    msghdr* const header = &messages[i].msg_hdr;
    for (cmsghdr* part = CMSG_FIRSTHDR(header); part != nullptr; part = CMSG_NXTHDR(header, part)) {
      if (part->cmsg_level != SOL_SOCKET || part->cmsg_type != SCM_TIMESTAMPNS) continue;
      timespec stamp{};
      std::memcpy(&stamp, CMSG_DATA(part), sizeof stamp);
      stamp = timespec_of(ns_of(stamp) + *added());
      std::memcpy(CMSG_DATA(part), &stamp, sizeof stamp);
    }
  }
  return count;
}
}
