// The real-time loop of one machine: for every frame it predicts the tracking error of the cycle
// from the commands, and compares it with the encoder value of the same frame.
//
//   predicted error of cycle k = twin(commands up to k); the encoder value of cycle k is read
//   afterwards
//
// An axis that is pushed by the motion of another one is predicted with the motion that the other
// twin predicts (daemon/loop/acting_acceleration.h).
//
// A new model is received at a sample boundary (daemon/between/latest_value.h). Its twin first runs
// through the command history, a bounded number of samples per cycle, and takes over when it has
// caught up; until then the old twin predicts. After lost cycles, a jump of time or a command that
// is not finite, the twin starts again at rest at the next command; its state is
// AxisState::kSettling until the slowest mode of the model has decayed.
//
// With live corrections (daemon/loop/live_offsets.h) the command of a frame is the one that the
// drives follow: that of the program plus the offset. The offsets of a cycle are sent together with
// its prediction.
//
// One thread. It sleeps only in FrameSource::receive; on_frame takes no lock, allocates nothing,
// writes no log or file and throws nothing (tests/daemon/loop/rt). Its output leaves through rings.
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
#include "daemon/loop/acting_acceleration.h"
#include "daemon/loop/live_offsets.h"
#include "drivers/common/messages.h"
#include "twin/contour.h"

namespace servotwin::daemon {

/// The number of cycles after which the effect of a wrong initial state is below 1 %.
[[nodiscard]] int settling_cycles(const Model& model);

/// Written by the loop, read by any thread. Accesses are relaxed: the figures are for display and
/// order no other data.
struct LoopCounters {
  std::atomic<std::uint64_t> turns{0};  ///< returns from receive(), with or without a frame
  std::atomic<std::uint64_t> frames{0};
  std::atomic<std::uint64_t> lost{0};  ///< missing cycles, by the sequence numbers
  /// Frames with the sequence number of the one before; ignored.
  std::atomic<std::uint64_t> repeated{0};
  std::atomic<std::uint64_t> time_jumps{0};  ///< stamps or sequence numbers that go back or jump
  std::atomic<std::uint64_t> malformed{0};   ///< frames with a wrong number of axes; ignored
  std::atomic<std::uint64_t> not_finite{0};  ///< commands or encoder values, summed over the axes
  std::atomic<std::uint64_t> overruns{0};    ///< cycles whose work took longer than the cycle
  Histogram wake;  ///< time from the frame being due or sent until the loop has it
  Histogram work;  ///< time from the frame to the end of the work on its cycle
};

/// The state of one axis in the loop: its twins and its command history.
class AxisLoop {
 public:
  static constexpr int kHistory = 2048;      // commands kept for a new model; 2 s at 1 kHz
  static constexpr int kCatchUpCycles = 64;  // samples of the history per cycle: about 10 us

  /// Starts to use a new model, which first runs through the command history.
  void take(const TwinInForce& model) noexcept;
  /// Forgets the command history, after a gap.
  void forget() noexcept;
  /// The command of a new cycle [m | rad].
  void note(double command) noexcept;
  /// Predicts the error of the cycle that was noted last, from commands alone [m | rad]. `all`: the
  /// axes of the machine, each with its command of this cycle; those that are pushed by motion come
  /// after the others.
  AxisPrediction predict(std::span<const AxisLoop> all) noexcept;
  /// Whether it needs the predicted motion of another axis.
  [[nodiscard]] bool by_motion() const noexcept {
    return in_force_.by_motion && in_force_.neighbour >= 0;
  }
  /// As the axes see it that it acts on.
  [[nodiscard]] SeenAxis seen() const noexcept {
    return {settled() ? &in_force_ : nullptr, &in_force_.twin, last_};
  }
  /// The model that predicts the coming cycles; null where nothing is predicted.
  [[nodiscard]] const TwinInForce* predicting() const noexcept {
    return in_force_.version != 0 && count_ > 0 ? &in_force_ : nullptr;
  }

 private:
  /// Whether it has forgotten how it started, and the last command that no axis follows.
  [[nodiscard]] bool settled() const noexcept;
  /// Counts for how long the motion of the axis that acts has been known.
  void note_acting(std::span<const AxisLoop> all) noexcept;
  double catch_up(std::span<const AxisLoop> all) noexcept;
  /// The axis as it was that many cycles ago, from its history.
  [[nodiscard]] SeenAxis seen_then(std::uint64_t ago) const noexcept;

  TwinInForce in_force_, next_;
  bool catching_up_ = false;
  bool bad_sample_ = false;     // the last command was not finite
  std::uint64_t count_ = 0;     // commands since the last start
  std::uint64_t next_fed_ = 0;  // of those, fed to next_
  std::uint64_t run_ = 0;       // cycles that the twin in force has run since its start
  std::uint64_t next_run_ = 0;
  std::uint64_t sane_ = 0;  // cycles since the last command that no axis follows
  std::uint64_t calm_ = 0;  // cycles since the motion of the acting axis began, or ceased, to act
  bool moved_by_motion_ = false;                  // it acts now
  std::array<double, kHistory> history_{};        // commands
  std::array<double, kHistory> accelerations_{};  // predicted
  LastCycles last_;
};

class RealTimeLoop {
 public:
  /// `cycle_s`: cycle time. `models`: one per axis, 1 to kMaxAxes. `paths`: for every path the
  /// indices of its axes, 2 to kMaxPathAxes; the published contour error is the largest of all
  /// paths. Throws std::invalid_argument if a number is wrong. All arguments except `paths` must
  /// outlive the loop.
  RealTimeLoop(double cycle_s, std::span<LatestValue<TwinInForce>> models,
               Ring<MachinePrediction>& predictions, Ring<CycleRow>& rows, const WakeUp& publisher,
               const std::vector<std::vector<std::size_t>>& paths = {});

  /// Enables live corrections: the offsets of every cycle go to the source and into this ring. Call
  /// it before the first frame; both must outlive the loop.
  void give_back(LiveOffsets& offsets, Ring<DatedOffset>& said) noexcept;
  /// Runs until the source ends or `stop` is set.
  void run(FrameSource& source, const std::atomic<bool>& stop) noexcept;
  /// Processes one frame. Returns the offsets to be sent in this cycle; null: none. Valid until the
  /// next call.
  const MachineOffset* on_frame(const MachineFrame& frame, const Arrival& arrival) noexcept;
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
  /// Adds the contour errors of this path to the prediction, where they are the largest. `frame`:
  /// with the commands that the drives follow. The path is that of the program, without offsets.
  void add_contour(Path& path, const MachineFrame& frame, Order order) noexcept;
  /// Predicts the errors of coming cycles from their commands; NaN without a model. The axes take
  /// turns as in on_frame, so that what is predicted ahead comes true.
  void look_ahead(const MachineFrame& frame) noexcept;

  std::int64_t cycle_ns_;
  std::span<LatestValue<TwinInForce>> models_;
  Ring<MachinePrediction>& predictions_;
  Ring<CycleRow>& rows_;
  const WakeUp& publisher_;
  LiveOffsets* offsets_ = nullptr;
  Ring<DatedOffset>* said_ = nullptr;

  std::vector<AxisLoop> axes_;
  std::vector<Path> paths_;
  std::vector<SeenAxis> seen_;  // while looking ahead
  std::vector<Twin> ahead_;     // of those that are stepped together
  std::array<PathPoint, kMaxLookAhead> path_ahead_{};
  MachineFrame frame_;
  MachinePrediction prediction_;
  CycleRow row_;
  bool first_ = true;
  bool row_dropped_ = false;
  bool predicted_ = false;  // the last frame has a prediction
  std::uint64_t last_sequence_ = 0;
  std::int64_t last_time_ns_ = 0;
  LoopCounters counters_;
};

}  // namespace servotwin::daemon
