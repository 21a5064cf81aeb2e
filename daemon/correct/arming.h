// Whether offsets may be sent to drives: only if the configuration has `live` and a person has
// armed the daemon. Arming is not stored: a daemon starts disarmed. Any thread; errors: none. Only
// forbid() waits for the disk.
#pragma once

#include <atomic>
#include <functional>
#include <mutex>
#include <string>
#include <utility>

#include "daemon/store/event_log.h"

namespace servotwin::daemon {

class Arming {
 public:
  /// Gives the reason why offsets must not be sent; empty: they may. Called by any thread.
  using Reason = std::function<std::string()>;

  /// `for_good`: as forbid(); `for_now`: while there is a reason. Both are asked whenever somebody
  /// arms or looks. All arguments must outlive the object.
  Arming(
      bool live, std::atomic<bool>& armed, EventLog& events,
      Reason for_good = [] { return std::string(); }, Reason for_now = [] { return std::string(); })
      : live_(live),
        armed_(armed),
        events_(events),
        for_good_(std::move(for_good)),
        for_now_(std::move(for_now)) {}

  [[nodiscard]] bool live() const noexcept { return live_; }
  /// Disarms first where there is a reason to.
  [[nodiscard]] bool armed() {
    if (const std::string why = for_good_(); !why.empty()) forbid(why);
    if (!for_now_().empty()) disarm();
    // relaxed, here and below: the flag orders nothing.
    return armed_.load(std::memory_order_relaxed);
  }
  /// Arms. Returns why that is not possible; empty if it is armed now.
  std::string arm() {
    if (const std::string why = for_good_(); !why.empty()) forbid(why);
    // So that forbid() cannot run between the check and arming.
    const std::lock_guard lock(mutex_);
    if (!forbidden_.empty()) return forbidden_;
    if (!live_) return "offsets are a dry run: the configuration does not have ilc.live = true";
    if (std::string why = for_now_(); !why.empty()) return why;
    if (!armed_.exchange(true, std::memory_order_relaxed))
      events_.note_soon("offsets_armed", "",
                        "armed: from the next run on, offsets are sent to drives");
    return {};
  }
  /// Disarms: active offsets fade to 0.
  void disarm() {
    if (armed_.exchange(false, std::memory_order_relaxed))
      events_.note_soon("offsets_disarmed", "", "disarmed: offsets are not sent to drives");
  }
  /// Disarms until the next start of the daemon. The first call reports the reason as an event.
  void forbid(const std::string& why) {
    armed_.store(false, std::memory_order_relaxed);  // at once, whoever holds the lock
    {
      const std::lock_guard lock(mutex_);
      armed_.store(false, std::memory_order_relaxed);
      if (!forbidden_.empty()) return;
      forbidden_ = why;
    }
    events_.error("offsets_held_back", "", why);  // may wait for the disk, arm() must not
  }
  /// Disarms for good, without an event: the daemon ends.
  void end() {
    const std::lock_guard lock(mutex_);
    if (forbidden_.empty()) forbidden_ = "the daemon is stopping";
    armed_.store(false, std::memory_order_relaxed);
  }

 private:
  bool live_;
  std::mutex mutex_;
  std::string forbidden_;
  std::atomic<bool>& armed_;
  EventLog& events_;
  Reason for_good_, for_now_;
};

}  // namespace servotwin::daemon
