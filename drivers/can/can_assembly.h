// Assembles the frames of the buses to one MachineFrame per cycle.
// A cycle begins with its SYNC (or another message of the mapping) and takes its time stamp. It is
// complete when every message with a command, an actual value, a torque or a following error has
// been received. A value that is not received by the deadline is NaN in that cycle; its message is
// counted as late if it is received afterwards, else as missing. Positions modulo a turn are
// unwound: the command from cycle to cycle, the actual value to the turn nearest to its command.
//
// A pure function of frames and times. on_frame, on_time and take belong to one thread, allocate
// nothing and throw nothing; counts() may be called by any thread.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "drivers/can/can_counts.h"
#include "drivers/can/can_frame.h"
#include "drivers/can/can_map.h"
#include "twin/sample.h"

namespace servotwin {

/// How the number of cycles that have passed is determined.
enum class Pacing : std::uint8_t {
  kByStamp,  ///< by the stamps of the cycles' starts: a lost SYNC is noticed
  kByCount,  ///< by counting starts, where several frames share a stamp (CAN over UDP);
             ///< CanFrame::after_gap marks losses
};

class CanAssembly {
 public:
  explicit CanAssembly(CanMap map, Pacing pacing = Pacing::kByStamp);

  /// Processes a frame. Afterwards call take() until it returns false.
  void on_frame(std::size_t bus, const CanFrame& frame) noexcept;
  /// The clock of the stamps shows `now_ns`, and all frames received until then have been passed
  /// in.
  void on_time(std::int64_t now_ns) noexcept;
  /// The clock of the stamps was set forward by `by_ns`.
  void on_clock_set(std::int64_t by_ns) noexcept;
  /// The next cycle, if it is complete or its deadline has passed; else false.
  [[nodiscard]] bool take(MachineFrame& frame) noexcept;
  /// The deadline of the open cycle for its messages; nothing if no cycle is open.
  [[nodiscard]] std::optional<std::int64_t> deadline_ns() const noexcept;

  [[nodiscard]] const CanMap& map() const noexcept { return map_; }
  [[nodiscard]] CanCounts counts() const;
  /// Frames of a message that were refused for their length. Any thread.
  [[nodiscard]] std::uint64_t wrong_length(std::size_t message) const noexcept {
    return messages_[message].wrong_length.load(std::memory_order_relaxed);
  }

 private:
  enum class Arrival : std::uint8_t { kAwaited, kCame, kLate };
  struct Message {
    Arrival arrival = Arrival::kAwaited;
    std::uint64_t missing_in_a_row = 0;
    std::atomic<std::uint64_t> received{0}, late{0}, missing{0}, repeated{0}, wrong_length{0},
        silences{0};
    std::atomic<bool> silent{false};
  };
  struct Bus {
    std::atomic<std::uint64_t> frames{0}, unexpected{0}, error_frames{0}, bus_off{0}, restarted{0},
        passive{0}, lost_in_controller{0}, not_acknowledged{0}, protocol{0};
  };
  struct Axis {
    double command = kAbsent, actual = kAbsent;  // the last ones, unwound
  };
  struct Cycle {
    std::uint64_t sequence = 0;
    std::int64_t time_ns = 0;
    std::array<AxisSample, kMaxAxes> axes{};
  };

  void on_error_frame(Bus& bus, const CanFrame& frame) noexcept;
  void note_unexpected(std::size_t bus, const CanFrame& frame) noexcept;
  void begin_cycle(const CanFrame& frame) noexcept;
  void end_cycle() noexcept;
  void deliver(std::size_t message, const CanFrame& frame) noexcept;
  void emit() noexcept;
  [[nodiscard]] AxisSample sample_of(std::size_t axis) noexcept;
  [[nodiscard]] double value_of(std::size_t axis, CanChannel channel) const noexcept;

  CanMap map_;
  Pacing pacing_;
  std::int64_t cycle_ns_, deadline_ns_;
  std::uint64_t silent_cycles_;

  std::vector<std::uint64_t> keys_;                       // of messages, sorted
  std::vector<std::size_t> by_key_;                       // the message of each key
  std::vector<std::vector<std::size_t>> signals_of_;      // of each message, what the machine sends
  std::vector<std::array<int, kCanChannels>> signal_of_;  // of each axis; -1: none
  std::vector<double> values_;                            // of each signal in this cycle
  std::unique_ptr<Message[]> messages_;
  std::unique_ptr<Bus[]> buses_;
  std::vector<Axis> axes_;
  std::size_t awaited_messages_ = 0;

  bool open_ = false, emitted_ = false, begun_ = false, lost_ = false;
  std::size_t awaited_ = 0;
  std::uint64_t sequence_ = 0;
  std::int64_t start_ns_ = 0;  // stamp of the cycle's start
  std::int64_t time_ns_ = 0;   // of the cycle; the same but for Pacing::kByCount
  std::array<Cycle, 2> ready_;
  std::size_t ready_first_ = 0, ready_count_ = 0;

  std::atomic<std::uint64_t> cycles_{0}, incomplete_{0};
  std::array<std::atomic<std::uint64_t>, CanCounts::kUnexpectedIds> unexpected_{};
};

}  // namespace servotwin
