// The real-time loop of one machine: a frame comes, the error of its cycle is predicted, then
// measured.
//
//   predicted error of cycle k = twin(commands up to k); the encoder value of cycle k is read
//   afterwards
//
// A new model comes at a sample boundary (daemon/between/latest_value.h). It is fed the command
// history first, a bounded number of cycles per cycle, and takes over when it has caught up; until
// then the old one predicts. After lost cycles, a jump of time or a command that is not a number
// the twin starts again at rest at the next command, and says so (AxisState::kSettling) until the
// model's slowest mode has died out.
//
// Where corrections are given back (daemon/loop/live_offsets.h), what a frame commands is what the
// drives follow: the program's command with the offset. The offsets of a cycle leave with its
// prediction.
//
// One thread. It sleeps only in FrameSource::receive; on_frame takes no lock and no memory, writes
// no log or file and throws nothing (tests/daemon/loop/rt). What it has to say leaves through the
// two rings.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <span>
#include <vector>

#include "daemon/between/cycle_row.h"
#include "daemon/between/histogram.h"
#include "daemon/between/latest_value.h"
#include "daemon/between/ring.h"
#include "daemon/between/wake_up.h"
#include "daemon/input/frame_source.h"
#include "drivers/messages.h"
#include "twin/contour.h"

namespace servotwin::daemon {

class LiveOffsets;

/// The cycles after which a wrong starting state has fallen below one percent.
[[nodiscard]] int settling_cycles(const Model& model);

/// Written by the loop, read by any thread; numbers for people, so relaxed: they order nothing.
struct LoopCounters {
  std::atomic<std::uint64_t> turns{0};  ///< returns from receive, with a frame or without
  std::atomic<std::uint64_t> frames{0};
  std::atomic<std::uint64_t> lost{0};  ///< cycles that never came, by the sequence numbers
  std::atomic<std::uint64_t> repeated{
      0};  ///< frames with the sequence number of the one before; ignored
  std::atomic<std::uint64_t> time_jumps{0};  ///< stamps or sequence numbers that do not follow
  std::atomic<std::uint64_t> malformed{0};   ///< frames with another number of axes; ignored
  std::atomic<std::uint64_t> not_finite{0};  ///< commands or encoder values, by axis
  std::atomic<std::uint64_t> overruns{0};    ///< cycles whose work took longer than the cycle
  Histogram wake;                            ///< from the frame being due or sent to the loop
  Histogram work;                            ///< from the frame to the end of its cycle's work
};

/// What the loop keeps of one axis.
class AxisLoop {
 public:
  static constexpr int kHistory = 2048;      // commands kept for a new model; 2 s at 1 kHz
  static constexpr int kCatchUpCycles = 64;  // fed per cycle: about 10 us

  /// The newest model that came since the last cycle.
  void take(const TwinInForce& model) noexcept;
  /// What came before does not count any more.
  void forget() noexcept;
  /// One cycle: the prediction from the command alone.
  AxisPrediction predict(double command) noexcept;
  /// The errors of coming cycles.
  void look_ahead(std::span<const double> commands, std::span<double> errors) const noexcept;

 private:
  double catch_up() noexcept;

  TwinInForce in_force_, next_;
  bool catching_up_ = false;
  std::uint64_t count_ = 0;     // commands since the last start
  std::uint64_t next_fed_ = 0;  // of those, fed to next_
  std::uint64_t run_ = 0;       // cycles that the twin in force has run since its start
  std::uint64_t next_run_ = 0;
  std::array<double, kHistory> history_{};
};

class RealTimeLoop {
 public:
  /// `models`: one per axis; throws std::invalid_argument if that is none or too many. `paths`:
  /// of every path the axes, by number, whose commands draw it, 2 to kMaxPathAxes; the contour
  /// error is that of the axes that are farthest from theirs. The rings and the rest outlive the
  /// loop.
  RealTimeLoop(double cycle_s, std::span<LatestValue<TwinInForce>> models,
               Ring<MachinePrediction>& predictions, Ring<CycleRow>& rows, const WakeUp& publisher,
               const std::vector<std::vector<std::size_t>>& paths = {});

  /// Corrections are given back, and each cycle's offsets go to the source and into this ring.
  /// Before the first frame; both outlive the loop.
  void give_back(LiveOffsets& offsets, Ring<MachineOffset>& said) noexcept;
  /// Until the source ends or `stop` is set.
  void run(FrameSource& source, const std::atomic<bool>& stop) noexcept;
  /// The offsets that are to be sent for this cycle; null: none. Valid until the next call.
  const MachineOffset* on_frame(const MachineFrame& frame) noexcept;
  [[nodiscard]] const LoopCounters& counters() const noexcept { return counters_; }

 private:
  enum class Order { kFollows, kAfterGap, kRepeats };
  Order order_of(const MachineFrame& frame) noexcept;
  struct Path {
    explicit Path(const std::vector<std::size_t>& of)
        : axes(of), contour(static_cast<int>(of.size())) {}
    std::vector<std::size_t> axes;
    ContourError contour;
  };
  /// `frame`: as the drives follow it. The path is that of the program.
  [[nodiscard]] double contour_error(Path& path, const MachineFrame& frame, Order order) noexcept;

  std::int64_t cycle_ns_;
  std::span<LatestValue<TwinInForce>> models_;
  Ring<MachinePrediction>& predictions_;
  Ring<CycleRow>& rows_;
  const WakeUp& publisher_;
  LiveOffsets* offsets_ = nullptr;
  Ring<MachineOffset>* said_ = nullptr;

  std::array<AxisLoop, kMaxAxes> axes_;
  std::vector<Path> paths_;
  std::array<PathPoint, kMaxLookAhead> path_ahead_{};
  MachineFrame frame_;
  MachinePrediction prediction_;
  CycleRow row_;
  bool first_ = true;
  bool row_dropped_ = false;
  std::uint64_t last_sequence_ = 0;
  std::int64_t last_time_ns_ = 0;
  LoopCounters counters_;
};

}  // namespace servotwin::daemon
