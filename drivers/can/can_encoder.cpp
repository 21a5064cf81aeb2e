#include "drivers/can/can_encoder.h"

#include <algorithm>
#include <cmath>

namespace servotwin {

CanEncoder::CanEncoder(const CanMap& map) : map_(map) {
  for (const MappedMessage& message : map.messages) {
    CanFrame frame;
    frame.id = message.id;
    frame.extended = message.extended;
    frame.fd = message.length > static_cast<int>(CanFrame::kClassicBytes);
    frame.length = static_cast<std::uint8_t>(
        can_length_at_least(static_cast<std::size_t>(message.length), frame.fd));
    if (message.selector)
      set_raw_bits(message.selector->signal, message.selector->value, frame.data);
    frames_.push_back(frame);
  }
}

bool CanEncoder::set(std::size_t axis, CanChannel channel, double value) noexcept {
  const MappedSignal* signal = map_.find(axis, channel);
  if (signal == nullptr) return false;
  // A position that wraps around before the range of its bits ends.
  const double full = std::ldexp(std::abs(signal->signal.scale), signal->signal.length);
  if (signal->turn > 0.0 && signal->turn < 0.999999 * full)
    value -= signal->turn * std::floor(value / signal->turn);
  std::uint64_t raw = 0;
  if (!encoded(signal->signal, value, signal->turn > 0.0, raw)) return false;
  set_raw_bits(signal->signal, raw, frames_[signal->message].data);
  return true;
}

CanFrame CanEncoder::start() const noexcept {
  CanFrame frame;
  frame.id = map_.start.id;
  frame.extended = map_.start.extended;
  return frame;
}

bool CanEncoder::carries(std::size_t message, CanChannel channel) const noexcept {
  return std::any_of(map_.signals.begin(), map_.signals.end(), [&](const MappedSignal& signal) {
    return signal.message == message && signal.channel == channel;
  });
}

}  // namespace servotwin
