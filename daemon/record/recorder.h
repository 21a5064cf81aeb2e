// The recorder: takes the rows from the real-time loop into the motion memory, past the residual
// alarms and into files.
//
// Files: `directory`/recordings/<machine>/<start, UTC>.csv, 30 s each, as every recording of ours;
// the oldest are deleted when all of them together are larger than the budget, but none that a
// model was found or judged on: where these alone are more than the budget, that is said. No file
// is begun that could make them more than the ceiling: recording stops until there is room, which
// is looked for every 30 s, and that is said. A file
// appears when it is complete: a crash loses at most the last 30 s of raw rows, never a model. If
// the disk refuses, the machine is watched as before, and what was not recorded is counted and
// said. One worker thread; errors while running are events.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <limits>
#include <mutex>
#include <optional>
#include <set>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "daemon/between/ring.h"
#include "daemon/record/motion_memory.h"
#include "daemon/record/residual_watch.h"
#include "daemon/store/event_log.h"

namespace servotwin::daemon {

/// How much the files of a machine may be together [MB].
struct RecordingRoom {
  double budget_mb = 0.0;  ///< the oldest are deleted beyond this; 0: none are written
  double most_mb = std::numeric_limits<double>::infinity();  ///< also of those that models cite
};

class Recorder {
 public:
  static constexpr double kFile_s = 30.0;

  /// Throws std::runtime_error if the directory cannot be made.
  Recorder(const MachineDescription& machine, const std::string& machine_name,
           const std::filesystem::path& directory, const RecordingRoom& room, Ring<CycleRow>& rows,
           MotionMemory& memory, ResidualWatch& watch, EventLog& events);

  /// Until asked to stop, and then until the ring is empty and the last file is written.
  void run(const std::stop_token& stop);
  /// From the next file on. Any thread.
  void keep(const RecordingRoom& room) noexcept {
    budget_bytes_.store(room.budget_mb * 1e6, std::memory_order_relaxed);  // orders nothing
    most_bytes_.store(room.most_mb * 1e6, std::memory_order_relaxed);      // likewise
  }
  /// Takes what waits in the ring; true if there was something.
  bool drain();
  /// Writes what has been collected.
  void finish_file();
  /// The files with rows of this time of the motion memory, also the one that is being collected.
  /// Any thread.
  [[nodiscard]] std::vector<std::string> files_with(double from_s, double until_s) const;
  /// Asks this which files models cite (Store::cited). Before run().
  void spare(std::function<std::set<std::string>()> cited) { cited_ = std::move(cited); }
  /// Why rows are not recorded though they should be, for people; empty: they are. Any thread.
  [[nodiscard]] std::string problem() const;
  /// Rows that are in no file though they should be. Any thread.
  [[nodiscard]] std::uint64_t rows_not_recorded() const noexcept {
    return not_recorded_.load(std::memory_order_relaxed);  // a number for people; orders nothing
  }

 private:
  enum class State : std::uint8_t { kRecords, kRefused, kFull };

  void collect(const CycleRow& row);
  /// False where there is no room for another file.
  [[nodiscard]] bool begin_file(const CycleRow& row);
  [[nodiscard]] bool is(State state) const noexcept {
    return state_.load(std::memory_order_relaxed) == state;  // a fact for people; orders nothing
  }
  void become(State state) noexcept { state_.store(state, std::memory_order_relaxed); }
  /// The largest that the files may be together so that another one fits below the ceiling.
  [[nodiscard]] double most_before_file() const noexcept { return most_bytes_ - file_bytes_; }
  void keep_within_budget();
  void delete_oldest();
  void judge_room(double bytes);
  void remove(const std::filesystem::path& file);

  std::filesystem::path directory_;
  std::atomic<double> budget_bytes_, most_bytes_;
  double file_bytes_;  // no file of kFile_s is larger
  Ring<CycleRow>& rows_;
  MotionMemory& memory_;
  ResidualWatch& watch_;
  EventLog& events_;
  Recording empty_;  // the machine's columns
  Recording file_;
  std::int64_t file_start_ns_ = 0;  // stamp of its first row
  std::string file_name_;
  struct Span {
    std::string name;
    double from_s = 0.0, until_s = 0.0;  // of the motion memory
  };
  mutable std::mutex spans_mutex_;
  std::deque<Span> spans_;  // of this run, as long as the files are there
  std::function<std::set<std::string>()> cited_;
  std::atomic<State> state_{State::kRecords};
  std::optional<std::int64_t> looked_ns_;  // for room, by the rows' stamps
  bool over_budget_ = false;               // and nothing could be done about it
  bool deleted_ = false;
  bool spared_ = false;  // more than the budget, because models cite it
  std::atomic<std::uint64_t> not_recorded_{0};
};

}  // namespace servotwin::daemon
