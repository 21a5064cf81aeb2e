// The service manager (systemd), or nobody: told how far the daemon is, and that its real-time loop
// gets on.
//
// The watchdog (sd_watchdog_enabled(3)) says WATCHDOG=1 as long as the loop turns. The loop counts
// every return from `receive`, with a frame or without, so that a silent machine is no stall; a
// busy identification does not count at all. Where no loop runs, before a machine has come and
// while the workers finish, there is nothing that could stall. A manager that hears nothing for
// WatchdogSec starts the daemon again.
// The thread runs above the loop: one that is overloaded and never sleeps is no stall either, its
// overruns are counted.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <thread>

namespace servotwin::daemon {

class ServiceManager {
 public:
  /// Whoever $NOTIFY_SOCKET and $WATCHDOG_USEC name.
  ServiceManager();

  /// One datagram (sd_notify(3)). Any thread.
  void notify(const std::string& state) const noexcept;
  /// How often it wants to hear that all is well [s]; 0: it does not ask.
  [[nodiscard]] double watchdog_s() const noexcept { return watchdog_s_; }

 private:
  std::string socket_;
  double watchdog_s_ = 0.0;
};

class Watchdog {
 public:
  /// `stalled` is called once when the loop stops getting on. Both outlive the watchdog.
  Watchdog(const ServiceManager& manager, int loop_priority,
           std::function<void(double silent_s)> stalled);
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

  /// From now on this counter has to move; nullptr: nothing has to.
  void watch(const std::atomic<std::uint64_t>* turns);

 private:
  void run(const std::stop_token& stop);

  const ServiceManager& manager_;
  int loop_priority_;
  std::function<void(double)> stalled_;
  std::mutex mutex_;
  std::condition_variable_any wake_;
  const std::atomic<std::uint64_t>* turns_ = nullptr;
  std::jthread thread_;  // the last one: it uses all the others
};

}  // namespace servotwin::daemon
