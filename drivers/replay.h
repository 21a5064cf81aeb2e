// A recording as the machine that made it: one frame per row, numbered by its time.
//
// The cycle is the median step of the time column. A frame's sequence number is its time in cycles,
// so that a gap of the recording is a loss of frames, as it was. What is known ahead of time are
// the commands of the rows that follow, as far as no gap is between. Any one thread. Errors:
// std::runtime_error.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "drivers/messages.h"
#include "twin/sample.h"

namespace servotwin {

class Replay {
 public:
  /// `look_ahead`: commands ahead of time in every frame, 0..kMaxLookAhead. Throws if there are no
  /// two rows of rising time, no axis or too many.
  explicit Replay(Recording recording, int look_ahead = 0);

  [[nodiscard]] const MachineDescription& machine() const noexcept { return machine_; }
  /// The next frame, stamped with the recording's time; false at the end. Allocates nothing.
  [[nodiscard]] bool next(MachineFrame& frame) noexcept;
  /// Seconds from the first row to the row that comes next.
  [[nodiscard]] double elapsed_s() const noexcept;
  [[nodiscard]] std::size_t rows() const noexcept { return recording_.time.size(); }
  /// Rows that were left out because their time is not a number.
  [[nodiscard]] std::size_t rows_without_time() const noexcept { return without_time_; }

 private:
  [[nodiscard]] std::int64_t cycles_to(std::size_t row) const noexcept;

  Recording recording_;
  MachineDescription machine_;
  int look_ahead_;
  std::size_t without_time_ = 0;
  std::size_t row_ = 0;
};

/// The median step of a time column [s]; throws std::runtime_error if time does not rise.
[[nodiscard]] double median_step(const std::vector<double>& time, const std::string& source);

}  // namespace servotwin
