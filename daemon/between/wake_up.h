// Wakes a worker thread from the real-time loop: an eventfd, one system call, no lock, no
// allocation. Errors: the constructor throws std::runtime_error.
#pragma once

#include <poll.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <string>

namespace servotwin::daemon {

class WakeUp {
 public:
  WakeUp() : event_(eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC)) {
    if (event_ < 0) throw std::runtime_error(std::string("eventfd: ") + std::strerror(errno));
  }
  WakeUp(const WakeUp&) = delete;
  WakeUp& operator=(const WakeUp&) = delete;
  ~WakeUp() { close(event_); }

  /// Any thread. Several calls before the worker wakes up count as one.
  void notify() const noexcept { eventfd_write(event_, 1); }
  /// Worker thread only: sleeps until notified, at most `timeout_ms`.
  void wait(int timeout_ms) const noexcept {
    pollfd event{event_, POLLIN, 0};
    poll(&event, 1, timeout_ms);
    eventfd_t count = 0;
    eventfd_read(event_, &count);
  }

 private:
  int event_;
};

}  // namespace servotwin::daemon
