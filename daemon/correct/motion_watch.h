// The commands of a machine for as long as its repetitions may be recognised in them, and what
// repeats as a program.
//
// Kept are kMaxWatchedValues commands at most (the oldest quarter is dropped at once), and of a
// pause no more than kLongestInnerPause_s: longer ones count as pauses of differing length anyway.
//
// SI units. One thread; errors: none.
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "daemon/between/offset_plan.h"
#include "daemon/correct/repeating_motion.h"
#include "drivers/common/messages.h"
#include "twin/sample.h"

namespace servotwin::daemon {

/// Rows times axes, 34 MB: three repetitions of a program of three axes that takes 7 minutes at
/// 1 kHz.
inline constexpr std::size_t kMaxWatchedValues = std::size_t{1} << 22U;

class MotionWatch {
 public:
  /// `tolerance`: within which two rows are the same [m | rad].
  MotionWatch(const MachineDescription& machine, double tolerance);

  /// Adds the newest rows of all axes of the machine. Whether a move has ended in them, so that it
  /// is worth to look.
  [[nodiscard]] bool take(const Recording& news);
  /// Forgets all rows: they are no longer those of a program.
  void forget();

  [[nodiscard]] std::optional<RepeatingMotion> repetition() const;
  /// Time between the begins of two repetitions, the shortest and the longest [s].
  [[nodiscard]] std::pair<double, double> periods_s(const RepeatingMotion& found) const;
  /// The part as a program to learn. It is named after its motion: the same after a restart.
  [[nodiscard]] CommandedPath program_of(const RepeatedPart& part) const;

 private:
  void add(double time_s, const Recording& news, std::size_t row);
  void repeat_last(const Recording& news, std::size_t row);
  /// Puts a row without commands where cycles are missing: it is the same as no other one.
  void mark_missing();
  void drop_oldest();

  MachineDescription machine_;
  double tolerance_;
  std::size_t longest_pause_;  // in rows
  std::vector<double> time_;   // [s], one per row
  std::vector<std::vector<double>> command_;
  std::vector<std::size_t> long_steps_;  // rows before which cycles may be missing, oldest first
  std::size_t still_ = 0;                // rows since the last motion
  bool moved_ = false;                   // since the last move that has ended
};

}  // namespace servotwin::daemon
