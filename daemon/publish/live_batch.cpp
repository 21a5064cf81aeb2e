#include "daemon/publish/live_batch.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace servotwin::daemon {
namespace {

/// A cycle of a point; `first`: the point begins with it.
void append(LiveSeries& series, double value, bool first, bool points_are_cycles) {
  if (first) {
    series.value.push_back(value);
    if (points_are_cycles) return;
    series.least.push_back(value);
    series.greatest.push_back(value);
    return;
  }
  series.value.back() = value;
  // fmin and fmax pass over what is NaN.
  series.least.back() = std::fmin(series.least.back(), value);
  series.greatest.back() = std::fmax(series.greatest.back(), value);
}

}  // namespace

LiveBatcher::LiveBatcher(double cycle_s, std::size_t axes)
    : cycle_s_(cycle_s),
      cycles_per_point_(std::max(
          1, static_cast<int>(
                 std::ceil(static_cast<double>(axes) / (cycle_s * kMaxPointsPerSecond) - 1e-9)))),
      cycles_per_batch_(
          cycles_per_point_ *
          std::max(1, static_cast<int>(std::lround(kBatch_s / (cycle_s * cycles_per_point_))))) {
  batch_.axes.resize(axes);
}

std::optional<LiveBatch> LiveBatcher::add(const MachinePrediction& cycle) {
  const bool follows = any_ && cycle.sequence == last_sequence_ + 1;
  std::optional<LiveBatch> complete;
  if (!follows) complete = flush();
  if (cycles_ == 0) begin(cycle);
  if (!follows) batch_.after_gap = true;
  any_ = true;
  last_sequence_ = cycle.sequence;
  put(cycle);
  if (cycles_ == cycles_per_batch_) complete = flush();
  return complete;
}

std::optional<LiveBatch> LiveBatcher::flush() {
  if (cycles_ == 0) return std::nullopt;
  LiveBatch empty;
  empty.axes.resize(batch_.axes.size());
  cycles_ = 0;
  return std::exchange(batch_, std::move(empty));
}

void LiveBatcher::begin(const MachinePrediction& cycle) {
  batch_.first_sequence = cycle.sequence;
  batch_.first_time_ns = cycle.time_ns;
  batch_.cycles_per_point = cycles_per_point_;
  batch_.point_s = cycle_s_ * cycles_per_point_;
  batch_.after_gap = false;
}

void LiveBatcher::put(const MachinePrediction& cycle) {
  const bool first = cycles_ % cycles_per_point_ == 0, plain = cycles_per_point_ == 1;
  const std::size_t axes = std::min(batch_.axes.size(), static_cast<std::size_t>(cycle.axis_count));
  for (std::size_t i = 0; i < axes; ++i) {
    const AxisPrediction& from = cycle.axes[i];
    LiveAxisBatch& to = batch_.axes[i];
    append(to.command, from.command, first, plain);
    append(to.measured, from.measured_error, first, plain);
    append(to.predicted, from.predicted_error, first, plain);
    append(to.residual, from.residual, first, plain);
    to.model_version = from.model_version;
    to.state = from.state;
  }
  append(batch_.contour, cycle.contour_error, first, plain);
  append(batch_.measured_contour, cycle.measured_contour_error, first, plain);
  ++cycles_;
}

}  // namespace servotwin::daemon
