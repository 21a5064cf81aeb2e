// A machine on its CAN buses, as a source of frames: waits on all of them at once, merges what came
// by its stamps, and assembles cycles (drivers/can_assembly.h).
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
#include "daemon/input/frame_source.h"
#include "drivers/can_assembly.h"
#include "drivers/can_bus.h"

namespace servotwin::daemon {

class CanSource final : public FrameSource {
 public:
  /// One bus per bus of the map; throws std::invalid_argument if there are more or fewer.
  CanSource(CanMap map, std::vector<std::unique_ptr<CanBus>> buses, Pacing pacing);

  /// Offsets of these axes are sent from now on, until somebody else sends some at the same time:
  /// then none are until the daemon is started again, and state() says why. Throws
  /// std::runtime_error if the mapping has no place for one (daemon/input/can_offset.h). Before the
  /// first frame.
  void carry_offsets(const std::vector<std::size_t>& axes);

  Received receive(MachineFrame& frame, double timeout_s) noexcept override;
  void send(const MachineOffset& offset) noexcept override;
  [[nodiscard]] std::int64_t age_ns() const noexcept override;
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
  /// Everything that was counted, at one moment.
  struct Snapshot {
    CanCounts counts;
    std::vector<CanBusCounts> buses;
    bool stalled = false;
  };

  void refill(std::size_t bus) noexcept;
  /// The bus whose next frame is the oldest one that is here; none if nothing is.
  [[nodiscard]] int oldest() noexcept;
  void wait(double timeout_s) noexcept;
  void follow_clock() noexcept;
  /// Notes who else sends offsets to a drive of ours: two that do would each correct what the other
  /// adds.
  void heed_other_sender(std::size_t bus, const CanFrame& frame) noexcept;
  [[nodiscard]] Snapshot snapshot() const;

  CanAssembly assembly_;
  std::vector<std::unique_ptr<CanBus>> buses_;
  struct Carried {
    std::size_t axis, message;  // of the map
    CanOffset offset;
  };
  std::vector<Carried> carried_;
  std::vector<std::size_t> order_;  // in which they are read: the one with the cycles' start last
  std::vector<Queue> queues_;
  std::int64_t clock_offset_ns_ = 0;  // of the clock of the stamps to the steady one
  std::int64_t completed_ns_ = 0;     // when the cycle that came last was whole or over
  std::int64_t last_cycle_ns_ = 0;    // steady
  std::int64_t patience_ns_;          // for a cycle to begin
  std::atomic<bool> stalled_{false};
  static constexpr std::int64_t kTogether_ns = 1'000'000'000;
  // Of offsets [steady]: when ours left, when somebody else's came. Both within a second: two at
  // once.
  std::optional<std::int64_t> sent_ns_, rival_ns_;
  std::atomic<int> rival_{-1};  // axis to whose drive two have sent; none of ours leave then

  // Of news().
  Snapshot told_;
  std::int64_t told_ns_ = 0;
};

}  // namespace servotwin::daemon
