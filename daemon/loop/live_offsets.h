// The real-time side of corrections: recognises that a program repeats
// (daemon/loop/program_matcher.h), asks the gate of every axis for the offset of the cycle in which
// it will be applied (ilc/gate.h), and measures the result.
//
//   seen(frame)     separates the command of the program from the offset that the drives add
//   answer(..)      the offsets that are applied `delay_cycles` later; none without a run
//
// A run is a dry run unless the configuration has `live` and a person has armed it; this is decided
// when the run begins. A run begins only when no offset is active. It ends, and its offset is faded
// out, when a residual is outside its band for kCyclesOutsideToEnd cycles, when the path error is
// larger than predicted without a correction, when a gate refuses, when cycles are lost, when the
// commands no longer follow the program, or when somebody disarms. A program whose run was given up
// is not begun again before a new plan comes. If the clock of the frames goes back by more than the
// validity of an offset, active offsets are withdrawn by one answer with `send` false, and
// everything starts again; a drive on CAN, which gets no frame for such an answer, drops its offset
// as it does when a daemon has died.
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
  /// Band of the residual as a multiple of the largest residual on held-out data: residuals have
  /// rare peaks at reversals that the standard deviation does not cover.
  static constexpr double kBandOverHoldoutMax = 1.5;
  /// Consecutive cycles outside the band that end a run.
  static constexpr int kCyclesOutsideToEnd = 3;
  /// Time constant of the mean square contour error [cycles].
  static constexpr int kContourWindowCycles = 100;

  LiveOffsets(OffsetRules rules, OffsetHandOver& hand_over);

  /// The frame with the commands that the drives follow, that is with the offsets. `follows`: the
  /// cycle before was received.
  [[nodiscard]] const MachineFrame& seen(const MachineFrame& frame, bool follows) noexcept;
  /// The command of an axis in that frame without the offset [m | rad].
  [[nodiscard]] double nominal(std::size_t axis) const noexcept { return nominal_[axis]; }
  /// The offsets to be sent in this cycle; null: none. Valid until the next call.
  [[nodiscard]] const MachineOffset* answer(const MachineFrame& frame,
                                            const MachinePrediction& prediction) noexcept;

 private:
  enum class Phase : std::uint8_t {
    kNone,
    kRunning,
    kFading,  // the offset fades to 0; the run has been reported
  };
  struct Run {
    const LearnedProgram* learned = nullptr;
    bool live = false;
    std::int64_t ends_ns = 0;                           // time by which the offset must be 0
    std::int64_t validated_ns = 0;                      // by the clock of the frames
    Eigen::Index row = 0;                               // row of the program in this cycle
    Eigen::Index rows = 0;                              // since the run began
    std::array<int, kMaxAxes> outside{};                // consecutive cycles outside the band
    double window_measured = 0.0, window_before = 0.0;  // mean squares with exponential forgetting
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
  Eigen::Index counts_after_;  // rows of a run after which the correction is fully in effect
  std::vector<Gate> gates_;
  ProgramMatcher matcher_;
  const OffsetPlan* plan_ = nullptr;
  const OffsetPlan* next_ = nullptr;  // replaces plan_ when no run is affected
  std::int64_t plan_frame_ns_ = 0;    // stamp of the frame in which plan_ was received
  std::int64_t next_frame_ns_ = 0;
  std::optional<std::uint64_t> barred_;  // program given up, until the worker has decided
  bool matched_ = false;                 // a program was matched in the cycle before
  bool gap_ = true;
  bool came_before_ = false;
  std::int64_t time_ns_ = 0;  // of the frame before
  Phase phase_ = Phase::kNone;
  Run run_;
  std::vector<std::size_t> path_;  // linear axes of the run, indices in the program
  ContourError contour_{2};
  std::array<PathPoint, kMaxLookAhead> ahead_{};
  std::array<double, kMaxAxes> nominal_{};
  std::vector<MachineOffset> sent_;  // of the last delay_cycles cycles
  std::size_t newest_ = 0;           // of sent_
  MachineFrame seen_;
  MachineOffset offset_;
};

}  // namespace servotwin::daemon
