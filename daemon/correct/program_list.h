// What has become of the programs, for those who ask over HTTP: the learning worker shows it,
// others read it.
//
// Between a change of the folder of programs (daemon/correct/program_inbox.h) and the next look of
// the worker into it, the program counts as waiting or removed, so that nobody takes the result of
// the file before for that of the new one. Any thread; errors: none.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "daemon/between/offset_plan.h"

namespace servotwin::daemon {

struct ProgramState {
  enum class What : std::uint8_t {
    kWaiting,  ///< its file is there and not read yet
    kLearning,
    kLearned,     ///< its correction is kept
    kNotLearned,  ///< its file is there, and it has no correction
    kRecognised,  ///< the machine repeats it; it may be accepted
    kRemoved,     ///< its file has gone, and its correction will
  };
  What what = What::kWaiting;
  std::uint64_t revision = 0;                         ///< of the last that was read; 0: none
  std::string text;                                   ///< the last result for people; may be empty
  std::shared_ptr<const CommandedPath> recognised{};  ///< the path, if that is its state
};

/// The repetition that the machine is in.
struct MotionRepeats {
  std::vector<std::string> programs;  ///< whatever their state is
  std::size_t repetitions = 0;
  double shortest_period_s = 0.0, longest_period_s = 0.0;
};

class ProgramList {
 public:
  /// The file of this program has been put or replaced, or removed.
  void changed(const std::string& program, bool removed = false) {
    const std::lock_guard lock(mutex_);
    changed_[program] = {++changes_, removed};
  }
  /// The number of changes until now; to be taken before a look into the folder.
  [[nodiscard]] std::uint64_t changes() const {
    const std::lock_guard lock(mutex_);
    return changes_;
  }
  /// `states`: by the name of the program. `seen`: the changes before the last look. `repeats`: if
  /// the motion does now.
  void show(std::map<std::string, ProgramState> states, std::uint64_t seen,
            std::optional<MotionRepeats> repeats = {}) {
    const std::lock_guard lock(mutex_);
    states_.swap(states);
    repeats_ = std::move(repeats);
    std::erase_if(changed_, [&](const auto& one) { return one.second.number <= seen; });
  }
  [[nodiscard]] std::map<std::string, ProgramState> states() const {
    const std::lock_guard lock(mutex_);
    std::map<std::string, ProgramState> out = states_;
    for (const auto& [program, change] : changed_)
      out[program].what =
          change.removed ? ProgramState::What::kRemoved : ProgramState::What::kWaiting;
    return out;
  }
  [[nodiscard]] std::optional<MotionRepeats> repeats() const {
    const std::lock_guard lock(mutex_);
    return repeats_;
  }

 private:
  mutable std::mutex mutex_;
  std::uint64_t changes_ = 0;
  struct Change {
    std::uint64_t number = 0;
    bool removed = false;
  };
  std::map<std::string, Change> changed_;  // the last change of each program
  std::map<std::string, ProgramState> states_;
  std::optional<MotionRepeats> repeats_;
};

}  // namespace servotwin::daemon
