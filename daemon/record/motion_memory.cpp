#include "daemon/record/motion_memory.h"

#include <algorithm>
#include <cmath>

#include "daemon/between/clock.h"

namespace servotwin::daemon {
namespace {

// Step of the machine time where stamps go back: a gap that identification does not bridge.
constexpr double kRestartGap_s = 1.0;

template <class Column>
void drop_front(Column& column, std::size_t rows) {
  column.erase(column.begin(),
               column.begin() + static_cast<std::ptrdiff_t>(std::min(rows, column.size())));
}

std::size_t rows_of(double seconds, double cycle_s) {
  return static_cast<std::size_t>(std::ceil(seconds / cycle_s)) + 1;
}

}  // namespace

MotionMemory::MotionMemory(const MachineDescription& machine, double remembered_s)
    : machine_(machine),
      most_rows_(rows_of(remembered_s, machine.cycle_s)),
      moved_s_(machine.axes.size()) {
  for (const AxisDescription& axis : machine.axes) {
    AxisRecord record;
    record.name = axis.name;
    record.rotary = axis.rotary;
    record.torque_unit = axis.torque_unit;
    axes_.push_back(std::move(record));
  }
}

void MotionMemory::remember(double remembered_s) {
  const std::lock_guard lock(mutex_);
  most_rows_ = rows_of(remembered_s, machine_.cycle_s);
}

void MotionMemory::append(const CycleRow& row) {
  const std::lock_guard lock(mutex_);
  const bool first = time_.empty();
  const double step_s =
      first ? 0.0 : 1e-9 * static_cast<double>(between_ns(last_stamp_ns_, row.time_ns));
  newest_s_ += step_s < 0.0 ? kRestartGap_s : step_s;
  last_stamp_ns_ = row.time_ns;
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    AxisRecord& axis = axes_[i];
    const AxisSample& sample = row.axes[i];
    double moved_s = first ? 0.0 : moved_s_[i].back();
    if (!first && !row.after_gap && std::isfinite(sample.command) &&
        std::isfinite(axis.command.back()) && sample.command != axis.command.back()) {
      moved_s += machine_.cycle_s;
    }
    moved_s_[i].push_back(moved_s);
    axis.command.push_back(std::isfinite(sample.command) ? sample.command : kAbsent);
    axis.actual.push_back(std::isfinite(sample.actual) ? sample.actual : kAbsent);
    if (!axis.torque_unit.empty())
      axis.torque.push_back(std::isfinite(sample.torque) ? sample.torque : kAbsent);
  }
  time_.push_back(newest_s_);
  // Drops a fifth of the rows at once, so that the cost per row is small.
  if (time_.size() >= most_rows_ + most_rows_ / 4 + 1) forget_old();
}

void MotionMemory::forget_old() {
  const std::size_t rows = time_.size() - most_rows_;
  drop_front(time_, rows);
  for (std::vector<double>& moved : moved_s_) drop_front(moved, rows);
  for (AxisRecord& axis : axes_) {
    drop_front(axis.command, rows);
    drop_front(axis.actual, rows);
    drop_front(axis.torque, rows);
  }
}

double MotionMemory::moved_s(std::size_t axis) const {
  const std::lock_guard lock(mutex_);
  return moved_s_[axis].empty() ? 0.0 : moved_s_[axis].back();
}

std::optional<double> MotionMemory::time_when_moved(std::size_t axis, double moved_s) const {
  const std::lock_guard lock(mutex_);
  const std::vector<double>& moved = moved_s_[axis];
  const auto row = std::lower_bound(moved.begin(), moved.end(), moved_s) - moved.begin();
  if (row == static_cast<std::ptrdiff_t>(moved.size())) return std::nullopt;
  return time_[static_cast<std::size_t>(row)];
}

std::optional<double> MotionMemory::time_when_stood(std::size_t axis, double after_s,
                                                    double seconds) const {
  const std::lock_guard lock(mutex_);
  const std::vector<double>& moved = moved_s_[axis];
  auto begin = std::upper_bound(time_.begin(), time_.end(), after_s) - time_.begin();
  while (begin < static_cast<std::ptrdiff_t>(time_.size())) {
    const auto end = std::lower_bound(time_.begin() + begin, time_.end(),
                                      time_[static_cast<std::size_t>(begin)] + seconds) -
                     time_.begin();
    if (end == static_cast<std::ptrdiff_t>(time_.size())) return std::nullopt;
    const double by_end_s = moved[static_cast<std::size_t>(end)];
    if (by_end_s == moved[static_cast<std::size_t>(begin)])
      return time_[static_cast<std::size_t>(end)];
    // The axis moved in between: start again after the last of that motion.
    begin = std::lower_bound(moved.begin() + begin, moved.begin() + end, by_end_s) - moved.begin();
  }
  return std::nullopt;
}

double MotionMemory::oldest_s() const {
  const std::lock_guard lock(mutex_);
  return time_.empty() ? 0.0 : time_.front();
}

double MotionMemory::newest_s() const {
  const std::lock_guard lock(mutex_);
  return newest_s_;
}

Recording MotionMemory::copy(double after_s, double until_s, const std::string& source) const {
  const std::lock_guard lock(mutex_);
  const auto begin = std::upper_bound(time_.begin(), time_.end(), after_s) - time_.begin();
  const auto end = std::upper_bound(time_.begin(), time_.end(), until_s) - time_.begin();
  const auto part = [&](const std::vector<double>& column) {
    if (column.empty() || end <= begin) return std::vector<double>();
    return std::vector<double>(column.begin() + begin, column.begin() + end);
  };
  Recording out;
  out.source = source;
  out.time = part(time_);
  for (const AxisRecord& from : axes_) {
    out.axes.push_back({from.name, from.rotary, part(from.command), part(from.actual),
                        part(from.torque), from.torque_unit});
  }
  return out;
}

}  // namespace servotwin::daemon
