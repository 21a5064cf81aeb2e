// Notifies the service manager (systemd), if there is one, of the state of the daemon and of the
// progress of its real-time loop.
//
// The watchdog (sd_watchdog_enabled(3)) sends WATCHDOG=1 as long as the loop makes turns. The loop
// counts every return from `receive`, with or without a frame, so that a silent machine is not a
// stall; a long identification does not matter. While no loop runs, before a machine is known and
// while the workers finish, WATCHDOG=1 is always sent. A service manager that gets none for
// WatchdogSec restarts the daemon.
//
// The watchdog thread has a higher priority than the loop: an overloaded loop that never sleeps is
// not a stall either; its overruns are counted.
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
  /// Reads $NOTIFY_SOCKET and $WATCHDOG_USEC.
  ServiceManager();

  /// Sends one datagram (sd_notify(3)); does nothing without a service manager. Any thread.
  void notify(const std::string& state) const noexcept;
  /// Time within which the service manager expects WATCHDOG=1 [s]; 0: it does not.
  [[nodiscard]] double watchdog_s() const noexcept { return watchdog_s_; }

 private:
  std::string socket_;
  double watchdog_s_ = 0.0;
};

class Watchdog {
 public:
  /// `stalled` is called once when the loop stops making progress. `manager` must outlive the
  /// watchdog.
  Watchdog(const ServiceManager& manager, int loop_priority,
           std::function<void(double silent_s)> stalled);
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

  /// From now on this counter must change; nullptr: none is watched.
  void watch(const std::atomic<std::uint64_t>* turns);

 private:
  void run(const std::stop_token& stop);

  const ServiceManager& manager_;
  int loop_priority_;
  std::function<void(double)> stalled_;
  std::mutex mutex_;
  std::condition_variable_any wake_;
  const std::atomic<std::uint64_t>* turns_ = nullptr;
  std::jthread thread_;  // declared last: it uses the members above
};

}  // namespace servotwin::daemon
