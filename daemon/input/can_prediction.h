// Sends predictions to a PLC: the figures of the axes that the mapping has for it, in messages of
// their own, every prediction_period_s.
//
// A figure that is not known in this cycle is sent as 0, and prediction_valid of its axis says so.
// Two senders with one id would destroy each other's frames: as long as another one is heard,
// nothing is sent, and for a while after it. A second daemon on the bus is so a standby. How long
// it waits is a matter of chance, drawn anew whenever another sender is heard: of two that wait one
// begins first, and where both begin at once both step back.
//
// One thread, except alarm() and heard_other(): any thread. tell() and on_frame() allocate nothing
// and throw nothing. Source: drivers/can/can_map.h.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <random>
#include <span>
#include <vector>

#include "drivers/can/can_bus.h"
#include "drivers/can/can_encoder.h"
#include "drivers/common/messages.h"

namespace servotwin::daemon {

class CanPrediction {
 public:
  /// The wait is once to twice this, or this many periods of the other sender if that is more.
  static constexpr std::int64_t kQuiet_ns = 1'000'000'000;
  static constexpr std::int64_t kQuietPeriods = 3;

  /// `map` must outlive the object. `now_ns`: steady clock, here and below; nothing is sent before
  /// it was quiet for the wait. `seed`: another one in every daemon.
  CanPrediction(const CanMap& map, std::int64_t now_ns, std::uint32_t seed);

  /// The prediction of a cycle; it is sent if that is due.
  void tell(const MachinePrediction& prediction, std::span<const std::unique_ptr<CanBus>> buses,
            std::int64_t now_ns) noexcept;
  /// A frame from a bus, which is not our own.
  void on_frame(std::size_t bus, const CanFrame& frame, std::int64_t now_ns) noexcept;
  /// Whether the residual alarm of an axis is raised.
  void alarm(std::size_t axis, bool raised) noexcept {
    alarms_[axis].store(raised, std::memory_order_relaxed);  // orders no data
  }
  /// Whether another sender is heard, and nothing is sent for that.
  [[nodiscard]] bool heard_other(std::int64_t now_ns) const noexcept;

 private:
  void put(std::size_t axis, const AxisPrediction& prediction) noexcept;
  /// The end of a wait that begins now [ns].
  [[nodiscard]] std::int64_t end_of_wait(std::int64_t now_ns) noexcept;

  CanEncoder encoder_;
  std::vector<std::size_t> messages_;  // of the map
  std::int64_t cycles_;                // between two messages
  std::int64_t waited_ = 0;            // cycles since the last
  std::int64_t quiet_ns_;              // the shortest wait
  std::minstd_rand chance_;
  std::int64_t begin_ns_;                        // nothing is sent before
  std::atomic<std::int64_t> other_until_ns_{0};  // 0: nobody was heard
  std::array<std::atomic<bool>, kMaxAxes> alarms_{};
};

}  // namespace servotwin::daemon
