// The last seconds of every axis, for identification and diagnosis. Written by the recorder, read
// by their workers; a mutex, because none of them is in a hurry.
//
// Time here is the machine's own, in seconds since its first frame, and never goes back: where the
// stamps of the frames do (the source was restarted), it goes on one second later.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "daemon/between/cycle_row.h"
#include "drivers/messages.h"
#include "twin/sample.h"

namespace servotwin::daemon {

class MotionMemory {
 public:
  /// `remembered_s`: at least this much is kept.
  MotionMemory(const MachineDescription& machine, double remembered_s);

  void append(const CycleRow& row);
  /// From now on this much is kept, at least.
  void remember(double remembered_s);

  /// How long an axis has moved since its first frame: time with the command changing [s].
  [[nodiscard]] double moved_s(std::size_t axis) const;
  /// The time at which it had moved that long; nothing if it has not yet. What is forgotten counts
  /// as the oldest row.
  [[nodiscard]] std::optional<double> time_when_moved(std::size_t axis, double moved_s) const;
  /// The time at which it had stood for `seconds` without a break, of the rows after `after_s`;
  /// nothing if it has not yet.
  [[nodiscard]] std::optional<double> time_when_stood(std::size_t axis, double after_s,
                                                      double seconds) const;
  /// The rows of one axis after one time until another, as a recording named `source`.
  [[nodiscard]] Recording copy(std::size_t axis, double after_s, double until_s,
                               const std::string& source) const;
  /// The same of all axes.
  [[nodiscard]] Recording copy(double after_s, double until_s, const std::string& source) const;
  /// The times of the oldest and the newest row that are here.
  [[nodiscard]] double oldest_s() const;
  [[nodiscard]] double newest_s() const;

 private:
  void forget_old();
  [[nodiscard]] Recording copy_axes(std::size_t first, std::size_t last, double after_s,
                                    double until_s, const std::string& source) const;

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
