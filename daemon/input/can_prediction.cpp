#include "daemon/input/can_prediction.h"

#include <algorithm>
#include <cmath>

#include "daemon/between/clock.h"

namespace servotwin::daemon {

CanPrediction::CanPrediction(const CanMap& map, std::int64_t now_ns, std::uint32_t seed)
    : encoder_(map),
      messages_(prediction_messages(map)),
      cycles_(
          std::max<std::int64_t>(1, std::llround(map.prediction_period_s / map.machine.cycle_s))),
      quiet_ns_(std::max<std::int64_t>(
          kQuiet_ns,
          std::llround(1e9 * static_cast<double>(kQuietPeriods) * map.prediction_period_s))),
      chance_(seed),
      begin_ns_(end_of_wait(now_ns)) {}

std::int64_t CanPrediction::end_of_wait(std::int64_t now_ns) noexcept {
  const double share = static_cast<double>(chance_()) / static_cast<double>(chance_.max());
  return now_ns + quiet_ns_ + std::llround(share * static_cast<double>(quiet_ns_));
}

void CanPrediction::tell(const MachinePrediction& prediction,
                         std::span<const std::unique_ptr<CanBus>> buses,
                         std::int64_t now_ns) noexcept {
  if (++waited_ < cycles_ || between_ns(begin_ns_, now_ns) < 0) return;
  waited_ = 0;
  for (int i = 0; i < prediction.axis_count; ++i) {
    const auto axis = static_cast<std::size_t>(i);
    put(axis, prediction.axes[axis]);
  }
  for (const std::size_t message : messages_)
    buses[encoder_.map().messages[message].bus]->send({&encoder_.frame(message), 1});
}

void CanPrediction::put(std::size_t axis, const AxisPrediction& prediction) noexcept {
  const CanMap& map = encoder_.map();
  bool valid = prediction.state == AxisState::kPredicting;
  for (const auto& [channel, value] :
       {std::pair{CanChannel::kPredictedError, prediction.predicted_error},
        std::pair{CanChannel::kResidual, prediction.residual}}) {
    if (map.find(axis, channel) != nullptr)
      valid = valid && encoder_.set(axis, channel, value);  // false where it is NaN or too large
  }
  if (!valid) {
    encoder_.set(axis, CanChannel::kPredictedError, 0.0);
    encoder_.set(axis, CanChannel::kResidual, 0.0);
  }
  encoder_.set(axis, CanChannel::kPredictionValid, valid ? 1.0 : 0.0);
  encoder_.set(axis, CanChannel::kAlarm, alarms_[axis].load(std::memory_order_relaxed) ? 1.0 : 0.0);
}

void CanPrediction::on_frame(std::size_t bus, const CanFrame& frame, std::int64_t now_ns) noexcept {
  const auto ours = [&](std::size_t index) {
    const MappedMessage& message = encoder_.map().messages[index];
    return message.bus == bus && message.id == frame.id && message.extended == frame.extended;
  };
  if (frame.error || !std::any_of(messages_.begin(), messages_.end(), ours)) return;
  begin_ns_ = end_of_wait(now_ns);
  other_until_ns_.store(begin_ns_, std::memory_order_relaxed);
}

bool CanPrediction::heard_other(std::int64_t now_ns) const noexcept {
  const std::int64_t until_ns = other_until_ns_.load(std::memory_order_relaxed);
  return until_ns != 0 && between_ns(until_ns, now_ns) < 0;
}

}  // namespace servotwin::daemon
