#include "drivers/replay.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace servotwin {

double median_step(const std::vector<double>& time, const std::string& source) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < time.size(); ++i) {
    if (time[i] > time[i - 1]) steps.push_back(time[i] - time[i - 1]);
  }
  if (steps.empty()) {
    throw std::runtime_error(source + ": cannot be replayed, it has no two rows of rising time");
  }
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

namespace {

template <class Column>
void keep(const std::vector<char>& wanted, Column& column) {
  std::size_t kept = 0;
  for (std::size_t row = 0; row < column.size(); ++row) {
    if (wanted[row] != 0) column[kept++] = column[row];
  }
  column.resize(kept);
}

std::size_t drop_rows_without_time(Recording& recording) {
  std::vector<char> wanted(recording.time.size());
  for (std::size_t row = 0; row < wanted.size(); ++row)
    wanted[row] = std::isfinite(recording.time[row]);
  const std::size_t before = recording.time.size();
  for (AxisRecord& axis : recording.axes) {
    keep(wanted, axis.command);
    keep(wanted, axis.actual);
    if (!axis.torque.empty()) keep(wanted, axis.torque);
  }
  keep(wanted, recording.time);
  return before - recording.time.size();
}

}  // namespace

Replay::Replay(Recording recording, int look_ahead)
    : recording_(std::move(recording)), look_ahead_(look_ahead) {
  if (recording_.axes.empty() || recording_.axes.size() > kMaxAxes) {
    throw std::runtime_error(recording_.source + ": " + std::to_string(recording_.axes.size()) +
                             " axes cannot be replayed, needs 1 to " + std::to_string(kMaxAxes));
  }
  if (look_ahead < 0 || look_ahead > kMaxLookAhead) {
    throw std::runtime_error("a look-ahead of " + std::to_string(look_ahead) +
                             " cycles: must be 0 to " + std::to_string(kMaxLookAhead));
  }
  machine_.cycle_s = median_step(recording_.time, recording_.source);
  without_time_ = drop_rows_without_time(recording_);
  for (const AxisRecord& axis : recording_.axes) {
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
  frame.sequence = static_cast<std::uint64_t>(std::max<std::int64_t>(cycle, 0));
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
