// The recorder: takes the rows from the real-time loop into the motion memory, past the residual
// alarms and into files.
//
// Files: `directory`/recordings/<machine>/<start, UTC>.csv, 30 s each, as every recording of ours;
// the oldest are deleted when all of them together are larger than the budget, but none that a
// model was found or judged on: where these alone are more than the budget, that is said. A file
// appears when it is complete: a crash loses at most the last 30 s of raw rows, never a model. If
// the disk refuses, the machine is watched as before, and what was not recorded is counted and
// said. One worker thread; errors while running are events.
#pragma once

#include <atomic>
#include <cstdint>
#include <deque>
#include <filesystem>
#include <functional>
#include <mutex>
#include <set>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "daemon/event_log.h"
#include "daemon/motion_memory.h"
#include "daemon/residual_watch.h"
#include "daemon/ring.h"

namespace servotwin {

class Recorder {
 public:
  static constexpr double kFile_s = 30.0;

  /// `budget_mb`: of all files together; 0: none are written. Throws std::runtime_error if the
  /// directory cannot be made.
  Recorder(const MachineDescription& machine, const std::string& machine_name,
           const std::filesystem::path& directory, double budget_mb, Ring<CycleRow>& rows,
           MotionMemory& memory, ResidualWatch& watch, EventLog& events);

  /// Until asked to stop, and then until the ring is empty and the last file is written.
  void run(const std::stop_token& stop);
  /// From the next row on. Any thread.
  void keep(double budget_mb) noexcept {
    budget_bytes_.store(budget_mb * 1e6, std::memory_order_relaxed);  // orders nothing
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
  /// Rows that are in no file though they should be. Any thread.
  [[nodiscard]] std::uint64_t rows_not_recorded() const noexcept {
    return not_recorded_.load(std::memory_order_relaxed);  // a number for people; orders nothing
  }

 private:
  void collect(const CycleRow& row);
  void keep_within_budget();
  void delete_oldest();
  void remove(const std::filesystem::path& file);

  std::filesystem::path directory_;
  std::atomic<double> budget_bytes_;
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
  bool failing_ = false;
  bool over_budget_ = false;  // and nothing could be done about it
  bool deleted_ = false;
  bool spared_ = false;  // more than the budget, because models cite it
  std::atomic<std::uint64_t> not_recorded_{0};
};

}  // namespace servotwin
