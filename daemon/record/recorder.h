// The recorder: passes the rows of the real-time loop to the motion memory, to the residual alarms
// and to files.
//
// Files: `directory`/recordings/<machine>/<start, UTC>.csv, 30 s each, in the usual CSV format.
// When all files together exceed the budget, the oldest are deleted, but none that a model was
// fitted to or judged on; if these alone exceed the budget, that is an event. No file is begun that
// could make the total exceed the ceiling: recording stops, checks every 30 s whether there is
// room, and reports both. A file appears when it is complete: a crash loses at most the last 30 s
// of raw rows, never a model. If the disk fails, memory and alarms continue, and missing rows are
// counted and reported. One worker thread; errors while running are events.
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

/// Limits of the total size of the files of a machine [MB].
struct RecordingRoom {
  double budget_mb = 0.0;  ///< the oldest files are deleted beyond this; 0: nothing is recorded
  /// The ceiling, including files that models cite.
  double most_mb = std::numeric_limits<double>::infinity();
};

class Recorder {
 public:
  static constexpr double kFile_s = 30.0;

  /// Throws std::runtime_error if the directory cannot be created.
  Recorder(const MachineDescription& machine, const std::string& machine_name,
           const std::filesystem::path& directory, const RecordingRoom& room, Ring<CycleRow>& rows,
           MotionMemory& memory, ResidualWatch& watch, EventLog& events);

  /// Runs until asked to stop, then empties the ring and writes the last file.
  void run(const std::stop_token& stop);
  /// Changes the limits, from the next file on. Any thread.
  void keep(const RecordingRoom& room) noexcept {
    budget_bytes_.store(room.budget_mb * 1e6, std::memory_order_relaxed);  // orders nothing
    most_bytes_.store(room.most_mb * 1e6, std::memory_order_relaxed);      // likewise
  }
  /// Processes the rows in the ring; true if there were any.
  bool drain();
  /// Writes the collected rows to a file.
  void finish_file();
  /// The files with rows of this time span of the motion memory, including the file that is being
  /// collected. Any thread.
  [[nodiscard]] std::vector<std::string> files_with(double from_s, double until_s) const;
  /// Sets the function that names the files that models cite (Store::cited). Call it before run().
  void spare(std::function<std::set<std::string>()> cited) { cited_ = std::move(cited); }
  /// Why rows are not recorded, one line for people; empty: they are recorded. Any thread.
  [[nodiscard]] std::string problem() const;
  /// Number of rows that should have been recorded and are in no file. Any thread.
  [[nodiscard]] std::uint64_t rows_not_recorded() const noexcept {
    return not_recorded_.load(std::memory_order_relaxed);  // for display; orders no data
  }

 private:
  enum class State : std::uint8_t { kRecords, kRefused, kFull };

  void collect(const CycleRow& row);
  /// False if there is no room for another file.
  [[nodiscard]] bool begin_file(const CycleRow& row);
  [[nodiscard]] bool is(State state) const noexcept {
    return state_.load(std::memory_order_relaxed) == state;  // for display; orders no data
  }
  void become(State state) noexcept { state_.store(state, std::memory_order_relaxed); }
  /// Maximum total size at which another file still fits below the ceiling [bytes].
  [[nodiscard]] double most_before_file() const noexcept { return most_bytes_ - file_bytes_; }
  void keep_within_budget();
  void delete_oldest();
  void judge_room(double bytes);
  void remove(const std::filesystem::path& file);

  std::filesystem::path directory_;
  std::atomic<double> budget_bytes_, most_bytes_;
  double file_bytes_;  // maximum size of a file of kFile_s
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
  std::deque<Span> spans_;  // of this run of the daemon, for files that still exist
  std::function<std::set<std::string>()> cited_;
  std::atomic<State> state_{State::kRecords};
  std::optional<std::int64_t> looked_ns_;  // last check for room, by the rows' stamps
  bool over_budget_ = false;               // the budget is exceeded, and files could not be deleted
  bool deleted_ = false;
  bool spared_ = false;  // the budget is exceeded by files that models cite
  std::atomic<std::uint64_t> not_recorded_{0};
};

}  // namespace servotwin::daemon
