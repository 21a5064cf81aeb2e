#include "daemon/web/live_feed.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace servotwin {

void LiveFeed::Sum::add(double value) {
  if (!std::isfinite(value)) return;
  ++count_;
  squares_ += value * value;
  max_ = std::max(max_, std::abs(value));
}

LiveFigures LiveFeed::Sum::take() {
  const Sum sum = std::exchange(*this, {});
  if (sum.count_ == 0) return {};
  return {std::sqrt(sum.squares_ / static_cast<double>(sum.count_)), sum.max_};
}

LiveFeed::LiveFeed(double cycle_s, std::size_t axes) : batcher_(cycle_s, axes), sums_(axes) {}

void LiveFeed::add(const MachinePrediction& cycle) {
  const std::size_t axes = std::min(sums_.size(), static_cast<std::size_t>(cycle.axis_count));
  for (std::size_t i = 0; i < axes; ++i) {
    sums_[i].measured.add(cycle.axes[i].measured_error);
    sums_[i].predicted.add(cycle.axes[i].predicted_error);
    sums_[i].residual.add(cycle.axes[i].residual);
  }
  contour_.add(cycle.contour_error);
  hand_over(batcher_.add(cycle));
}

void LiveFeed::add(const MachineStatus& status) {
  // Where the machine has fallen silent the last cycles are not held back.
  hand_over(batcher_.flush());
  LiveStatus live{status, {}, contour_.take()};
  for (AxisSums& sums : sums_)
    live.axes.push_back({sums.measured.take(), sums.predicted.take(), sums.residual.take()});
  const std::lock_guard lock(mutex_);
  news_.status = std::move(live);
}

void LiveFeed::add(const ModelAnnouncement& model) {
  const std::lock_guard lock(mutex_);
  news_.models.push_back(model);
}

void LiveFeed::add(const DiagnosisAnnouncement& diagnosis) {
  const std::lock_guard lock(mutex_);
  news_.diagnoses.push_back(diagnosis);
}

LiveFeed::News LiveFeed::take() {
  const std::lock_guard lock(mutex_);
  News next;
  next.dropped = news_.dropped;
  return std::exchange(news_, std::move(next));
}

void LiveFeed::hand_over(std::optional<LiveBatch> batch) {
  if (!batch) return;
  const std::lock_guard lock(mutex_);
  if (news_.batches.size() == kMostWaiting) {
    news_.batches.pop_front();
    ++news_.dropped;
  }
  news_.batches.push_back(std::move(*batch));
}

}  // namespace servotwin
