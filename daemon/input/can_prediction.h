// Sends predictions to a PLC: the figures of the axes that the mapping has for it, in messages of
// their own, every prediction_period_s.
//
// A figure that is not known in this cycle is sent as 0, and prediction_valid of its axis says so.
// Two senders with one id would destroy each other's frames: as long as another one is heard,
// nothing is sent, and for kQuiet_ns after it. A second daemon on the bus is so a standby.
//
// One thread, except alarm() and heard_other(): any thread. tell() and on_frame() allocate nothing
// and throw nothing. Source: drivers/can_map.h.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "drivers/can_bus.h"
#include "drivers/can_encoder.h"
#include "drivers/messages.h"

namespace servotwin::daemon {

class CanPrediction {
 public:
  static constexpr std::int64_t kQuiet_ns = 1'000'000'000;

  /// `map` must outlive the object. `now_ns`: steady clock, here and below; nothing is sent before
  /// it was quiet for kQuiet_ns.
  CanPrediction(const CanMap& map, std::int64_t now_ns);

  /// The prediction of a cycle; it is sent if that is due.
  void tell(const MachinePrediction& prediction, std::span<const std::unique_ptr<CanBus>> buses,
            std::int64_t now_ns) noexcept;
  /// A frame from a bus, which is not our own.
  void on_frame(std::size_t bus, const CanFrame& frame, std::int64_t now_ns) noexcept;
  /// Whether the residual alarm of an axis is raised.
  void alarm(std::size_t axis, bool raised) noexcept {
    alarms_[axis].store(raised, std::memory_order_relaxed);  // orders no data
  }
  /// Whether another sender was heard in the last kQuiet_ns.
  [[nodiscard]] bool heard_other(std::int64_t now_ns) const noexcept;

 private:
  void put(std::size_t axis, const AxisPrediction& prediction) noexcept;

  CanEncoder encoder_;
  std::vector<std::size_t> messages_;  // of the map
  std::int64_t cycles_;                // between two messages
  std::int64_t waited_ = 0;            // cycles since the last
  std::int64_t quiet_since_ns_;
  std::atomic<std::int64_t> heard_ns_{0};  // 0: nobody
  std::array<std::atomic<bool>, kMaxAxes> alarms_{};
};

}  // namespace servotwin::daemon
