#include "daemon/publish/live_feed.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace servotwin::daemon {

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
  measured_contour_.add(cycle.measured_contour_error);
  collect(batcher_.add(cycle));
}

void LiveFeed::add(const MachineStatus& status) {
  LiveStatus live{status, {}, contour_.take(), measured_contour_.take()};
  for (AxisSums& sums : sums_)
    live.axes.push_back({sums.measured.take(), sums.predicted.take(), sums.residual.take()});
  collected_.status = std::move(live);
  // When the machine is silent, the last cycles must not wait for a complete batch.
  collect(batcher_.flush());
  hand_over();
}

void LiveFeed::add(const ModelAnnouncement& model) {
  collected_.models.push_back(model);
  hand_over();
}

void LiveFeed::add(const DiagnosisAnnouncement& diagnosis) {
  collected_.diagnoses.push_back(diagnosis);
  hand_over();
}

LiveFeed::News LiveFeed::take() {
  const std::lock_guard lock(mutex_);
  News next;
  next.dropped = news_.dropped;
  return std::exchange(news_, std::move(next));
}

void LiveFeed::collect(std::optional<LiveBatch> batch) {
  if (!batch) return;
  collected_.batches.push_back(std::move(*batch));
  hand_over();
}

void LiveFeed::hand_over() {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  News& to = lock.owns_lock() ? news_ : collected_;
  if (lock.owns_lock()) {
    const News from = std::exchange(collected_, {});
    const auto append = [](auto& all, const auto& more) {
      all.insert(all.end(), more.begin(), more.end());
    };
    append(news_.batches, from.batches);
    append(news_.models, from.models);
    append(news_.diagnoses, from.diagnoses);
    if (from.status) news_.status = from.status;
    news_.dropped += from.dropped;
  }
  for (; to.batches.size() > kMaxWaitingBatches; ++to.dropped) to.batches.pop_front();
}

}  // namespace servotwin::daemon
