// Whether the daemon works: the real-time loop makes progress, the store can be written and is not
// damaged, cycles are recorded.
//
// A silent machine is not a problem of the daemon. One thread; the time is an argument.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "daemon/web/store_check.h"

namespace servotwin::daemon {

class Health {
 public:
  /// The loop makes a turn at least every 0.1 s.
  static constexpr std::int64_t kMaxLoopSilence_ns = 2'000'000'000;

  explicit Health(const StoreCheck& store) : store_(store) {}

  /// Reports the turns of the loop so far; nothing without a loop. To be called several times a
  /// second.
  void on_turns(std::optional<std::uint64_t> turns, std::int64_t now_ns);
  /// Reports why cycles are not recorded; empty: they are, or there are none.
  void on_recording(const std::string& problem) { recording_problem_ = problem; }
  /// The problems, one line each; empty if there are none.
  [[nodiscard]] std::vector<std::string> problems(std::int64_t now_ns) const;
  /// What people should know although the daemon works, one line each: what the store had lost when
  /// it was opened.
  [[nodiscard]] std::vector<std::string> notes() const;
  [[nodiscard]] StoreCheck::Seen store(std::int64_t now_ns) const { return store_.seen(now_ns); }

 private:
  const StoreCheck& store_;
  std::optional<std::uint64_t> turns_;
  std::int64_t turned_ns_ = 0;
  std::string recording_problem_;
};

}  // namespace servotwin::daemon
