// A frame source for a machine on CAN: waits on all buses at once, merges their frames by time
// stamp and assembles them to cycles (drivers/can/can_assembly.h).
//
// After its construction receive() allocates nothing and takes no lock. news() and the counts may
// be called by another thread.
#pragma once

#include <array>
#include <atomic>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "daemon/input/can_offset.h"
#include "daemon/input/can_prediction.h"
#include "daemon/input/frame_source.h"
#include "drivers/can/can_assembly.h"
#include "drivers/can/can_bus.h"

namespace servotwin::daemon {

class CanSource final : public FrameSource {
 public:
  /// One bus per bus of the map; throws std::invalid_argument if there are more or fewer.
  CanSource(CanMap map, std::vector<std::unique_ptr<CanBus>> buses, Pacing pacing);

  /// From now on send() sends offsets to the drives of these axes. If another sender sends offsets
  /// to one of them within a second, none are sent until the daemon is restarted, and state() gives
  /// the reason. Call it before the first frame. Throws std::runtime_error if the mapping has no
  /// offset of an axis (daemon/input/can_offset.h).
  void carry_offsets(const std::vector<std::size_t>& axes);

  /// From now on tell() sends the predictions that the mapping has for a PLC. Call it before the
  /// first frame.
  void tell_predictions();

  Received receive(MachineFrame& frame, double timeout_s) noexcept override;
  std::uint32_t send(const MachineOffset& offset, std::int64_t until_ns) noexcept override;
  void tell(const MachinePrediction& prediction) noexcept override;
  void show_alarm(std::size_t axis, bool raised) noexcept override;
  [[nodiscard]] std::int64_t age_ns() const noexcept override;
  /// By the kernel; the cycles of packets follow when it received them.
  [[nodiscard]] bool stamped_here() const noexcept override { return true; }
  [[nodiscard]] SourceState state(std::int64_t now_ns) const override;
  [[nodiscard]] std::vector<SourceNews> news(std::int64_t now_ns) override;

  [[nodiscard]] const CanMap& map() const noexcept { return assembly_.map(); }
  [[nodiscard]] CanCounts counts() const { return assembly_.counts(); }
  [[nodiscard]] CanBusCounts counts(std::size_t bus) const noexcept {
    return buses_[bus]->counts();
  }

 private:
  [[nodiscard]] std::uint64_t malformed() const noexcept;
  [[nodiscard]] std::string offsets_held_back() const;
  [[nodiscard]] std::vector<BusStatus> buses() const;
  struct Queue {
    std::array<CanFrame, 64> frames;
    std::size_t next = 0, count = 0;
    bool may_have_more = false;
  };
  /// All counters at one moment.
  struct Snapshot {
    CanCounts counts;
    std::vector<CanBusCounts> buses;
    bool stalled = false;
    bool other_tells = false;  // another sender of predictions is heard
  };

  void refill(std::size_t bus) noexcept;
  /// The bus whose next frame has the oldest stamp; -1 if no frame has been received.
  [[nodiscard]] int oldest() noexcept;
  void wait(double timeout_s) noexcept;
  void follow_clock() noexcept;
  /// Detects another sender of offsets to a drive that this daemon corrects: each of the two would
  /// correct what the other adds.
  void detect_other_sender(std::size_t bus, const CanFrame& frame) noexcept;
  [[nodiscard]] Snapshot snapshot() const;

  CanAssembly assembly_;
  std::vector<std::unique_ptr<CanBus>> buses_;
  struct Carried {
    std::size_t axis, message;  // of the map
    CanOffset offset;
  };
  std::vector<Carried> carried_;
  std::optional<CanPrediction> prediction_;
  std::vector<std::size_t> order_;  // reading order; the bus with the start of cycles is last
  std::vector<Queue> queues_;
  std::int64_t clock_offset_ns_ = 0;  // wall clock (of the stamps) minus steady clock
  std::int64_t completed_ns_ = 0;     // when the last cycle was complete, or its deadline
  std::int64_t last_cycle_ns_ = 0;    // steady
  std::int64_t patience_ns_;          // without a cycle for this long the source is stalled
  std::atomic<bool> stalled_{false};
  static constexpr std::int64_t kSimultaneous_ns = 1'000'000'000;
  // Steady times of the last own offset and of the last offset of another sender. Less than
  // kSimultaneous_ns apart means that both are active.
  std::optional<std::int64_t> sent_ns_, other_sender_ns_;
  std::atomic<int> other_sender_{-1};  // axis with two senders; -1: none. No offset is sent then

  // Of news().
  Snapshot reported_;
  std::int64_t reported_ns_ = 0;
};

}  // namespace servotwin::daemon
