#include "drivers/recordings/replay.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

#include "drivers/common/text.h"

namespace servotwin {

Replay::Replay(Recording recording, double cycle_s, int look_ahead)
    : recording_(std::move(recording)), look_ahead_(look_ahead) {
  if (recording_.axes.empty() || recording_.axes.size() > kMaxAxes) {
    throw std::runtime_error(recording_.source + ": " + std::to_string(recording_.axes.size()) +
                             " axes cannot be replayed, needs 1 to " + std::to_string(kMaxAxes));
  }
  if (look_ahead < 0 || look_ahead > kMaxLookAhead) {
    throw std::runtime_error("a look-ahead of " + std::to_string(look_ahead) +
                             " cycles: must be 0 to " + std::to_string(kMaxLookAhead));
  }
  machine_.cycle_s = cycle_s;
  if (recording_.time.empty() || !(cycle_s > 0.0)) {
    throw std::runtime_error(recording_.source + ": cannot be replayed without rows and a cycle");
  }
  // With two rows in one cycle, one frame would be ignored.
  for (std::size_t row = 0; row < rows(); ++row) {
    if (std::isfinite(recording_.time[row]) && (row == 0 || cycles_to(row) > cycles_to(row - 1)))
      continue;
    throw std::runtime_error(recording_.source + ": cannot be replayed, row " +
                             std::to_string(row + 1) + " has no cycle of its own");
  }
  for (const AxisRecord& axis : recording_.axes) {
    if (!usable_name(axis.name))
      throw std::runtime_error(recording_.source + ": cannot be replayed, the axis name " +
                               in_quotes(axis.name) + " " + std::string(kUsableNameRule));
    machine_.axes.push_back({axis.name, axis.rotary, axis.torque_unit});
  }
}

std::int64_t Replay::cycles_to(std::size_t row) const noexcept {
  return std::llround((recording_.time[row] - recording_.time.front()) / machine_.cycle_s);
}

double Replay::elapsed_s() const noexcept {
  const std::size_t row = std::min(row_, rows() - 1);
  return recording_.time[row] - recording_.time.front();
}

bool Replay::next(MachineFrame& frame) noexcept {
  if (row_ >= rows()) return false;
  const std::int64_t cycle = cycles_to(row_);
  frame.sequence = static_cast<std::uint64_t>(cycle);
  frame.time_ns = std::llround(recording_.time[row_] * 1e9);
  frame.axis_count = static_cast<int>(recording_.axes.size());
  frame.ahead_count = 0;
  while (frame.ahead_count < look_ahead_) {
    const std::size_t later = row_ + static_cast<std::size_t>(frame.ahead_count) + 1;
    if (later >= rows() || cycles_to(later) != cycle + frame.ahead_count + 1) break;
    ++frame.ahead_count;
  }
  for (std::size_t i = 0; i < recording_.axes.size(); ++i) {
    const AxisRecord& axis = recording_.axes[i];
    frame.axes[i] = {axis.command[row_], axis.actual[row_],
                     axis.torque.empty() ? kAbsent : axis.torque[row_]};
    for (std::size_t k = 0; k < static_cast<std::size_t>(frame.ahead_count); ++k) {
      frame.ahead[i][k] = axis.command[row_ + 1 + k];
    }
  }
  ++row_;
  return true;
}

}  // namespace servotwin
