// Whether the daemon works: the real-time loop makes progress, the store can be written, cycles are
// recorded.
//
// A silent machine is not a problem of the daemon. One thread; the time is an argument.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "daemon/store/store.h"

namespace servotwin::daemon {

class Health {
 public:
  /// The loop makes a turn at least every 0.1 s.
  static constexpr std::int64_t kMaxLoopSilence_ns = 2'000'000'000;
  static constexpr std::int64_t kStoreCheck_ns = 10'000'000'000;  // every check writes to the disk

  explicit Health(Store& store) : store_(store) {}

  /// Reports the turns of the loop so far; nothing without a loop. To be called several times a
  /// second.
  void on_turns(std::optional<std::uint64_t> turns, std::int64_t now_ns);
  /// Reports why cycles are not recorded; empty: they are, or there are none.
  void on_recording(const std::string& problem) { recording_problem_ = problem; }
  /// The problems, one line each; empty if there are none.
  [[nodiscard]] std::vector<std::string> problems(std::int64_t now_ns);

 private:
  Store& store_;
  std::optional<std::uint64_t> turns_;
  std::int64_t turned_ns_ = 0;
  std::optional<std::int64_t> tried_ns_;
  std::string store_problem_, recording_problem_;
};

}  // namespace servotwin::daemon
