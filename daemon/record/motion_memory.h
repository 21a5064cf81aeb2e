// The last seconds of every axis, for identification and diagnosis. Written by the recorder, read
// by the workers; protected by a mutex, because none of these threads is urgent. Errors: none.
//
// Times are machine time: seconds since the first frame. It never goes back: where the stamps of
// the frames do (restart of the source), it continues one second later.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "daemon/between/cycle_row.h"
#include "drivers/common/messages.h"
#include "twin/sample.h"

namespace servotwin::daemon {

class MotionMemory {
 public:
  /// `remembered_s`: minimum time that is kept [s].
  MotionMemory(const MachineDescription& machine, double remembered_s);

  void append(const CycleRow& row);
  /// Changes the minimum time that is kept [s].
  void remember(double remembered_s);

  /// How long an axis has moved since its first frame: time with the command changing [s].
  [[nodiscard]] double moved_s(std::size_t axis) const;
  /// The time at which the axis had moved for `moved_s`; nothing if it has not yet. For rows that
  /// were dropped, the time of the oldest row.
  [[nodiscard]] std::optional<double> time_when_moved(std::size_t axis, double moved_s) const;
  /// The first time at which the axis had stood still for `seconds` after `after_s`; nothing if it
  /// has not yet.
  [[nodiscard]] std::optional<double> time_when_stood(std::size_t axis, double after_s,
                                                      double seconds) const;
  /// The rows in (after_s, until_s], as a recording named `source`.
  [[nodiscard]] Recording copy(double after_s, double until_s, const std::string& source) const;
  /// The times of the oldest and of the newest row.
  [[nodiscard]] double oldest_s() const;
  [[nodiscard]] double newest_s() const;

 private:
  void forget_old();

  MachineDescription machine_;
  std::size_t most_rows_;
  mutable std::mutex mutex_;
  std::vector<double> time_;
  std::vector<AxisRecord> axes_;
  std::vector<std::vector<double>> moved_s_;  // of each axis, row by row
  std::int64_t last_stamp_ns_ = 0;
  double newest_s_ = 0.0;
};

}  // namespace servotwin::daemon
