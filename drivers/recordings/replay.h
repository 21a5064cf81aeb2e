// Replays a recording in place of the machine that made it: one frame per row, numbered by its
// cycle. A gap in the recording is a loss of frames. Commands that are known ahead of time are
// those of the following rows, up to the next gap. The cycle of each row is determined before, in
// daemon/input/recorded_cycles.h. Any one thread. Errors: std::runtime_error.
#pragma once

#include <cstddef>
#include <cstdint>

#include "drivers/common/messages.h"
#include "twin/sample.h"

namespace servotwin {

class Replay {
 public:
  /// `recording`: every row has a time of a whole number of cycles after the first row, and is
  /// later than the row before. `look_ahead`: number of commands ahead of time in every frame,
  /// 0..kMaxLookAhead. Throws if a row has no cycle of its own, or there is no row, no axis or too
  /// many.
  Replay(Recording recording, double cycle_s, int look_ahead = 0);

  [[nodiscard]] const MachineDescription& machine() const noexcept { return machine_; }
  /// The next frame, stamped with the recording's time; false at the end. Allocates nothing.
  [[nodiscard]] bool next(MachineFrame& frame) noexcept;
  /// Seconds from the first row to the row that comes next.
  [[nodiscard]] double elapsed_s() const noexcept;
  [[nodiscard]] std::size_t rows() const noexcept { return recording_.time.size(); }

 private:
  [[nodiscard]] std::int64_t cycles_to(std::size_t row) const noexcept;

  Recording recording_;
  MachineDescription machine_;
  int look_ahead_;
  std::size_t row_ = 0;
};

}  // namespace servotwin
