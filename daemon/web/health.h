// Whether the daemon does its work: does the real-time loop go on, can the store be written, are
// cycles recorded?
//
// A machine that is silent is no illness of the daemon. One thread; the time is an argument.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "daemon/store/store.h"

namespace servotwin::daemon {

class Health {
 public:
  static constexpr std::int64_t kLoopPatience_ns = 2'000'000'000;  // it turns every 0.1 s at least
  static constexpr std::int64_t kStoreLook_ns = 10'000'000'000;  // a try costs a write to the disk

  explicit Health(Store& store) : store_(store) {}

  /// The turns of the loop so far; nothing while there is none. Some times a second.
  void on_turns(std::optional<std::uint64_t> turns, std::int64_t now_ns);
  /// Why cycles are not recorded though they should be; empty: they are, or there are none.
  void on_recording(const std::string& problem) { recording_problem_ = problem; }
  /// What is wrong; nothing if all is well.
  [[nodiscard]] std::vector<std::string> problems(std::int64_t now_ns);

 private:
  Store& store_;
  std::optional<std::uint64_t> turns_;
  std::int64_t turned_ns_ = 0;
  std::optional<std::int64_t> tried_ns_;
  std::string store_problem_, recording_problem_;
};

}  // namespace servotwin::daemon
