// Virtual drives: they answer on the bus as CiA 402 nodes do, and move as a model predicts.
// At the start of every cycle (SYNC), an axis takes the target position received last, adds the
// position offset, lets the twin follow, and sends the signals that the mapping assigns to drives:
// demand, actual value, following error, torque (0), status word. Axes whose models are coupled
// push each other as in the daemon's loop (daemon/loop/acting_acceleration.h). If a control word is
// mapped, the axis holds its position until operation is enabled. An offset that is not renewed for
// kOffsetValidity_s is dropped, whoever sent it: it goes to zero at a constant rate within
// kOffsetRamp_s. Process data only: there is no object dictionary to be read (SDO) and no network
// management. One thread; on_frame allocates nothing. Source: CiA 402-2 (state machine), CiA 301
// (synchronous PDOs).
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "daemon/between/cycle_row.h"
#include "daemon/loop/acting_acceleration.h"
#include "drivers/can/can_encoder.h"
#include "drivers/can/can_frame.h"
#include "drivers/can/can_map.h"

namespace servotwin {

/// The state machine of a drive, set by the control word and shown in the status word.
class DriveState {
 public:
  enum class State : std::uint8_t { kSwitchOnDisabled, kReadyToSwitchOn, kSwitchedOn, kEnabled };
  void command(std::uint16_t control_word) noexcept;
  void enable() noexcept { state_ = State::kEnabled; }
  [[nodiscard]] bool enabled() const noexcept { return state_ == State::kEnabled; }
  [[nodiscard]] std::uint16_t status_word() const noexcept;

 private:
  State state_ = State::kSwitchOnDisabled;
};

class VirtualDrive {
 public:
  static constexpr double kOffsetValidity_s = 0.02;
  static constexpr double kOffsetRamp_s = 0.1;

  struct Answer {
    std::size_t bus = 0;
    CanFrame frame;
  };

  /// One twin per axis of the map. Throws std::runtime_error if an axis has no target, or if the
  /// message that begins the cycles is sent by the drives: then no cycle could begin.
  VirtualDrive(const CanMap& map, const std::vector<daemon::TwinInForce>& twins);

  /// The frames with which the drives answer this frame; valid until the next call.
  [[nodiscard]] std::span<const Answer> on_frame(std::size_t bus, const CanFrame& frame) noexcept;
  [[nodiscard]] std::uint64_t cycles() const noexcept { return cycles_; }
  /// Number of values that did not fit into their bits.
  [[nodiscard]] std::uint64_t not_carried() const noexcept { return not_carried_; }

 private:
  struct Axis {
    daemon::TwinInForce in_force;
    daemon::LastCycles last;
    DriveState state;
    bool started = false;
    bool has_target = false;
    double target = 0.0, offset = 0.0, demand = 0.0, actual = 0.0;
    int offset_age = 0;      // cycles since it came
    double fade_step = 0.0;  // of an offset that is dropped, per cycle
  };
  void take(std::size_t bus, const CanFrame& frame) noexcept;
  void drop_stale_offset(Axis& axis) const noexcept;
  void take_demand(Axis& axis) const noexcept;
  void follow(Axis& axis) noexcept;
  void say(std::size_t axis) noexcept;
  void step() noexcept;

  const CanMap& map_;
  CanEncoder encoder_;
  std::vector<Axis> axes_;
  std::vector<Answer> answers_;
  std::uint64_t cycles_ = 0, not_carried_ = 0;
};

}  // namespace servotwin
