#include "cli/live/virtual_drive.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace servotwin {

void DriveState::command(std::uint16_t word) noexcept {
  const unsigned bits = word & 0x0FU;
  if ((bits & 0x2U) == 0 || (bits & 0x4U) == 0) {  // disable voltage; quick stop ends there too
    state_ = State::kSwitchOnDisabled;
  } else if (bits == 0x6U) {  // shutdown
    state_ = State::kReadyToSwitchOn;
  } else if (bits == 0x7U && state_ != State::kSwitchOnDisabled) {  // switch on
    state_ = State::kSwitchedOn;
  } else if (bits == 0xFU && state_ != State::kSwitchOnDisabled) {  // enable operation
    state_ = State::kEnabled;
  }
}

std::uint16_t DriveState::status_word() const noexcept {
  // Remote, target used (bit 12 in the cyclic modes), voltage on, quick stop not active.
  switch (state_) {
    case State::kSwitchOnDisabled:
      return 0x0250;
    case State::kReadyToSwitchOn:
      return 0x0231;
    case State::kSwitchedOn:
      return 0x0233;
    case State::kEnabled:
      break;
  }
  return 0x1237;
}

VirtualDrive::VirtualDrive(const CanMap& map, const std::vector<daemon::TwinInForce>& twins)
    : map_(map), encoder_(map) {
  for (std::size_t i = 0; i < map.machine.axes.size(); ++i) {
    const std::string& name = map.machine.axes[i].name;
    if (map.find(i, CanChannel::kTarget) == nullptr) {
      throw std::runtime_error("axis " + name +
                               " has no target in the CAN mapping: a drive needs a target position "
                               "(object 0x607A in an RPDO)");
    }
    Axis axis;
    axis.in_force = twins.at(i);
    if (map.find(i, CanChannel::kControlWord) == nullptr) axis.state.enable();
    axes_.push_back(axis);
  }
  for (const MappedMessage& message : map.messages) {
    if (message.from_machine && message.bus == map.start.bus && message.id == map.start.id &&
        message.extended == map.start.extended) {
      throw std::runtime_error(
          message.name +
          " begins the cycles, but is sent by the drive itself; a virtual drive needs a SYNC");
    }
  }
  answers_.reserve(map.messages.size());
}

void VirtualDrive::take(std::size_t bus, const CanFrame& frame) noexcept {
  for (const MappedSignal& signal : map_.signals) {
    const MappedMessage& message = map_.messages[signal.message];
    if (message.from_machine || message.bus != bus || message.id != frame.id ||
        message.extended != frame.extended || frame.length < message.length) {
      continue;
    }
    const std::span<const std::uint8_t> data(frame.data.data(), frame.length);
    if (message.selector && raw_bits(message.selector->signal, data) != message.selector->value)
      continue;
    Axis& axis = axes_[signal.axis];
    const double value = decoded(signal.signal, data);
    if (!std::isfinite(value)) continue;
    if (signal.channel == CanChannel::kTarget) {
      // Of a target modulo a turn, the turn nearest to the previous target is meant.
      const double turns = signal.turn > 0.0 && axis.has_target
                               ? std::nearbyint((axis.target - value) / signal.turn)
                               : 0.0;
      axis.target = value + turns * signal.turn;
      axis.has_target = true;
    } else if (signal.channel == CanChannel::kOffset) {
      axis.offset = value;
      axis.offset_age = 0;
    } else if (signal.channel == CanChannel::kControlWord) {
      axis.state.command(static_cast<std::uint16_t>(raw_bits(signal.signal, data)));
    }
  }
}

void VirtualDrive::drop_stale_offset(Axis& axis) const noexcept {
  const double cycle_s = map_.machine.cycle_s;
  if (++axis.offset_age * cycle_s <= kOffsetValidity_s) {
    axis.fade_step = std::abs(axis.offset) * cycle_s / kOffsetRamp_s;
  } else {
    axis.offset -= std::clamp(axis.offset, -axis.fade_step, axis.fade_step);
  }
}

void VirtualDrive::take_demand(Axis& axis) const noexcept {
  drop_stale_offset(axis);
  if (axis.state.enabled() && axis.has_target) axis.demand = axis.target + axis.offset;
  if (!axis.has_target) return;
  if (!axis.started) {
    axis.demand = axis.target;
    axis.last = {};
  }
  axis.last.add(axis.demand);
}

void VirtualDrive::follow(Axis& axis) noexcept {
  Twin& twin = axis.in_force.twin;
  if (!axis.started) {
    twin.start(axis.demand);
    axis.actual = twin.position();
    axis.started = true;
    return;
  }
  const double acting = daemon::acting_on(axis.in_force, [&](int other) -> daemon::SeenAxis {
    const Axis& seen = axes_[static_cast<std::size_t>(other)];
    return {seen.started ? &seen.in_force : nullptr, &seen.in_force.twin, seen.last};
  });
  axis.actual = axis.demand - twin.follow(axis.demand, acting);
  axis.last.predict(twin.acceleration());
}

void VirtualDrive::say(std::size_t index) noexcept {
  const Axis& axis = axes_[index];
  const auto say = [&](CanChannel channel, double value) {
    if (map_.find(index, channel) != nullptr && !encoder_.set(index, channel, value))
      ++not_carried_;
  };
  say(CanChannel::kCommand, axis.demand);
  say(CanChannel::kActual, axis.actual);
  say(CanChannel::kFollowingError, axis.demand - axis.actual);
  say(CanChannel::kTorque, 0.0);
  say(CanChannel::kStatusWord, axis.state.status_word());
}

void VirtualDrive::step() noexcept {
  for (Axis& axis : axes_) take_demand(axis);
  for (const bool by_motion : {false, true}) {  // those that are pushed by motion come last
    for (Axis& axis : axes_) {
      if (axis.has_target && axis.in_force.by_motion == by_motion) follow(axis);
    }
  }
  for (std::size_t i = 0; i < axes_.size(); ++i) say(i);
}

std::span<const VirtualDrive::Answer> VirtualDrive::on_frame(std::size_t bus,
                                                             const CanFrame& frame) noexcept {
  answers_.clear();
  if (frame.error || frame.remote) return answers_;
  const CycleStart& start = map_.start;
  if (bus != start.bus || frame.id != start.id || frame.extended != start.extended) {
    take(bus, frame);
    return answers_;
  }
  ++cycles_;
  step();
  for (std::size_t i = 0; i < map_.messages.size(); ++i) {
    if (map_.messages[i].from_machine || encoder_.carries(i, CanChannel::kStatusWord))
      answers_.push_back({map_.messages[i].bus, encoder_.frame(i)});
  }
  return answers_;
}

}  // namespace servotwin
