// The real-time side of corrections: recognises that a program repeats
// (daemon/loop/program_matcher.h), asks the gate of every axis for the offset of the cycle in which
// it will be applied (ilc/gate.h), and measures what becomes of it.
//
//   seen(frame)     what of the frame's command is the program's, what is the offset that drives
//   add answer(..)      the offsets of `delay_cycles` later; none while there is nothing to say
//
// Dry run unless the configuration says live and a person has armed it; which of both a run is is
// settled when it begins. A run begins only from nothing, and is given up, its offset fading out,
// when a residual is beyond its band for kOutside cycles, when the path is followed worse than it
// would be without, when a gate refuses, cycles are lost, the commands are others, or somebody
// disarms. A program whose run was given up is not begun again until new plans come. Where the
// clock of the frames goes back by more than an offset is valid, what is out is taken back by one
// answer that sends nothing, and all begins anew; a drive that hears answers that send (CAN) drops
// it as it does when a daemon has died.
//
// One thread; nothing allocates, locks or throws after construction.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "daemon/between/offset_plan.h"
#include "daemon/loop/program_matcher.h"
#include "drivers/messages.h"
#include "ilc/gate.h"
#include "twin/contour.h"

namespace servotwin::daemon {

class LiveOffsets {
 public:
  /// Times the most that the model missed on its hold-out: residuals have rare peaks, at reversals,
  /// that no deviation tells.
  static constexpr double kBeyondMost = 1.5;
  static constexpr int kOutside = 3;   ///< cycles beyond the band until the machine is another one
  static constexpr int kWindow = 100;  ///< cycles that a contour error is judged over

  LiveOffsets(OffsetRules rules, OffsetHandOver& hand_over);

  /// The frame as the drives follow it: its command with the offset. `follows`: the cycle before
  /// came.
  [[nodiscard]] const MachineFrame& seen(const MachineFrame& frame, bool follows) noexcept;
  /// The command of an axis in that frame, without the offset.
  [[nodiscard]] double nominal(std::size_t axis) const noexcept { return nominal_[axis]; }
  /// What is to be said in this cycle; null: nothing. Valid until the next call.
  [[nodiscard]] const MachineOffset* answer(const MachineFrame& frame,
                                            const MachinePrediction& prediction) noexcept;

 private:
  enum class Phase : std::uint8_t {
    kNone,
    kRunning,
    kFading,  // what is out goes to nothing; the run has been reported
  };
  struct Run {
    const LearnedProgram* learned = nullptr;
    bool live = false;
    std::int64_t ends_ns = 0;                           // by then nothing must be out any more
    std::int64_t validated_ns = 0;                      // by the clock of the frames
    Eigen::Index row = 0;                               // of the program, in this cycle
    Eigen::Index rows = 0;                              // since it began
    std::array<int, kMaxAxes> outside{};                // cycles in a row beyond the band
    double window_measured = 0.0, window_before = 0.0;  // means of squares that forget
    OffsetRun seen;
  };

  void take_plan(const MachineFrame& frame) noexcept;
  void start_anew(const MachineFrame& frame) noexcept;
  void begin(Eigen::Index row, const LearnedProgram& learned, const MachineFrame& frame) noexcept;
  void end(RunEnd end, int axis = -1, Refusal refusal = Refusal::kNone) noexcept;
  void go_on(const MachineFrame& frame, const MachinePrediction& prediction) noexcept;
  void watch_residuals(const MachinePrediction& prediction) noexcept;
  void measure(const MachineFrame& frame) noexcept;
  void measure_contour(const MachineFrame& frame, bool counts) noexcept;
  void ask_gates(const MachineFrame& frame, const MachinePrediction& prediction) noexcept;

  OffsetRules rules_;
  OffsetHandOver& hand_over_;
  Eigen::Index counts_after_;  // rows since a run began: the correction is in as a whole
  std::vector<Gate> gates_;
  ProgramMatcher matcher_;
  const OffsetPlan* plan_ = nullptr;
  const OffsetPlan* next_ = nullptr;  // takes its place when that costs nothing
  std::int64_t plan_frame_ns_ = 0;    // stamp of the frame with which it came
  std::int64_t next_frame_ns_ = 0;
  std::optional<std::uint64_t> barred_;  // number of what was given up, until it was ruled on
  bool matched_ = false;                 // in the cycle before
  bool gap_ = true;
  bool came_before_ = false;
  std::int64_t time_ns_ = 0;  // of the frame before
  Phase phase_ = Phase::kNone;
  Run run_;
  std::vector<std::size_t> path_;  // of the run: its linear axes, by number in the program
  ContourError contour_{2};
  std::array<PathPoint, kMaxLookAhead> ahead_{};
  std::array<double, kMaxAxes> nominal_{};
  std::vector<MachineOffset> sent_;  // of the last delay_cycles cycles
  std::size_t newest_ = 0;           // of sent_
  MachineFrame seen_;
  MachineOffset offset_;
};

}  // namespace servotwin::daemon
