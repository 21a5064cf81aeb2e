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
// clock of the frames jumps, when the commands no longer follow the program, or when somebody
// disarms. After a run was given up, the program is not corrected again until a new plan comes.
//
// What the drive has (docs/decisions/0011-one-contract-for-offsets.md). The drive holds the last
// offset for validity_s to drive_timeout_s of its own time after it was sent, and then ramps it to
// 0 within drive_ramp_s. So this class never assumes that an offset is gone because a stamp says
// so:
//   - The gates run on a clock of their own, which counts cycles. Jumps of the frames' clock do not
//     reach them, and an offset changes by at most one cycle's rate from one sent frame to the
//     next.
//   - A frame is not answered if the answer would come more than half a cycle late, and an answer
//     that has not left by then does not leave, so that a drive never gets two offsets in one of
//     its cycles. The constant delay of the bus must be below half a cycle for that.
//   - If nothing could be sent for validity_s, the drive may have begun to ramp out: nothing is
//     sent until it has certainly reached 0. The same after the start of the daemon:
//     the one before may have left an offset. How long it was is shown by the clock of this host,
//     by the clock of the frames, and by their sequence numbers: the longest counts.
//   - What was sent may be lost. Where the command of the frames contains the offset, it shows what
//     the drive has, as long as the commands follow the program. If that is not what was sent, or
//     if the publisher reports that an offset did not leave in time, nothing is sent until the
//     drive has certainly reached 0.
//
// One thread; nothing allocates, locks or throws after construction.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <vector>

#include "daemon/between/offset_plan.h"
#include "daemon/loop/program_matcher.h"
#include "drivers/common/messages.h"
#include "ilc/gate.h"
#include "twin/contour.h"

namespace servotwin::daemon {

/// When a frame was received.
struct Arrival {
  std::int64_t now_ns = 0;  ///< steady clock of this host
  std::int64_t age_ns = 0;  ///< since it was due or sent, plus an unknown constant (two clocks)
};

/// Lateness of a frame relative to the earliest one: its age without the constant part, which is
/// transport and the difference of two hosts' clocks.
///
/// A daemon that answers late for a second must not take that for punctual: two of its answers
/// would reach a drive in one cycle. So the constant part grows only as fast as two clocks drift
/// apart, and only by frames that are nearly on time; and at once where all frames of a window are
/// later by more than a daemon is, or of a minute at all: then a clock was set.
class Lateness {
 public:
  explicit Lateness(std::int64_t cycle_ns) noexcept : on_time_ns_(cycle_ns / 4) {}
  /// Of the next frame [ns], >= 0, which came at `now_ns`.
  std::int64_t of(std::int64_t age_ns, std::int64_t now_ns) noexcept;

 private:
  static constexpr std::int64_t kDrift_ns_per_s = 100'000;  // two quartz clocks of 50 ppm each
  static constexpr std::int64_t kWindow_ns = 1'000'000'000;
  static constexpr std::int64_t kClockWasSet_ns =
      100'000'000;  // no daemon is late by so much for long
  static constexpr int kWindowsOfLateness = 60;
  std::int64_t on_time_ns_;  // lateness up to which a frame is nearly on time
  std::int64_t constant_ = std::numeric_limits<std::int64_t>::max();
  std::int64_t last_on_time_ns_ = 0;
  std::int64_t window_began_ns_ = 0, least_ = std::numeric_limits<std::int64_t>::max();
  int late_windows_ = 0;  // in a row, without a frame on time
};

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
                                            const MachinePrediction& prediction,
                                            const Arrival& arrival) noexcept;
  /// Until when the last answer may leave [ns], steady clock.
  [[nodiscard]] std::int64_t leaves_until_ns() const noexcept { return leaves_until_ns_; }
  /// DatedOffset::stream of the last answer.
  [[nodiscard]] std::uint64_t stream() const noexcept { return answer_stream_; }
  /// The last answer was not handed to the publisher: that has stood still for long.
  void not_handed_over() noexcept { handed_over_ = false; }
  /// The last answer left before this time [ns], steady clock.
  void has_left(std::int64_t now_ns) noexcept { left_ns_ = now_ns; }
  /// The last answer did not leave for these axes (bit i: axis i): their drives have the one
  /// before.
  void not_sent(std::uint32_t axes) noexcept;

 private:
  enum class Phase : std::uint8_t {
    kNone,
    kRunning,
    kFading,  // the offset fades to 0; the run has been reported
  };
  struct Run {
    const LearnedProgram* learned = nullptr;
    bool live = false;
    std::int64_t ends_ns = 0;             // time by which the offset must be 0, by the gates' clock
    std::int64_t validated_ns = 0;        // steady clock
    Eigen::Index row = 0;                 // row of the program in this cycle
    Eigen::Index rows = 0;                // since the run began
    std::array<int, kMaxAxes> outside{};  // consecutive cycles outside the band
    double window_measured = 0.0, window_before = 0.0;  // mean squares with exponential forgetting
    OffsetRun seen;
  };

  /// An offset that was sent, and the frame that it answers.
  struct Renewal {
    std::int64_t now_ns = 0, due_ns = 0;  // steady clock: when it was sent; when the frame was due
    std::uint64_t sequence = 0;
    std::int64_t time_ns = 0;  // of the frame
  };
  /// What the command of a frame shows of the offset in a drive.
  enum class Shown : std::uint8_t { kSent, kEarlier, kNeither };

  void take_plan(std::int64_t now_ns) noexcept;
  void withdraw(const MachineFrame& frame, RunEnd why, std::int64_t since_ns) noexcept;
  void follow_program(const MachineFrame& frame, std::int64_t now_ns, bool late) noexcept;
  void begin(Eigen::Index row, const LearnedProgram& learned, const MachineFrame& frame,
             std::int64_t now_ns) noexcept;
  [[nodiscard]] bool drive_has_dropped(const MachineFrame& frame, std::int64_t now_ns,
                                       std::int64_t due_ns) const noexcept;
  [[nodiscard]] bool not_delivered(const MachineFrame& frame) noexcept;
  [[nodiscard]] bool interrupted(std::int64_t now_ns) noexcept;
  [[nodiscard]] Shown shown_by(const MachineFrame& frame, std::size_t n) const noexcept;
  [[nodiscard]] bool too_late(std::int64_t now_ns, std::int64_t due_ns) const noexcept;
  void end(RunEnd end, int axis = -1, Refusal refusal = Refusal::kNone) noexcept;
  void go_on(const MachineFrame& frame, const MachinePrediction& prediction, std::int64_t now_ns,
             std::int64_t due_ns) noexcept;
  void watch_residuals(const MachinePrediction& prediction) noexcept;
  void measure(const MachineFrame& frame) noexcept;
  void measure_contour(const MachineFrame& frame, bool counts) noexcept;
  void ask_gates(const MachineFrame& frame, const MachinePrediction& prediction,
                 std::int64_t now_ns) noexcept;

  OffsetRules rules_;
  OffsetHandOver& hand_over_;
  Eigen::Index counts_after_;  // rows of a run after which the correction is fully in effect
  std::vector<Gate> gates_, gates_before_;  // before the last answer
  ProgramMatcher matcher_;
  const OffsetPlan* plan_ = nullptr;
  const OffsetPlan* next_ = nullptr;  // replaces plan_ when no run is affected
  std::int64_t plan_ns_ = 0;          // steady clock, when plan_ was received
  std::int64_t next_ns_ = 0;
  std::optional<std::uint64_t> barred_;  // program given up, until the worker has decided
  bool matched_ = false;                 // a program was matched in the cycle before
  bool gap_ = true;
  bool first_ = true;
  bool handed_over_ = true;  // each answer so far to the publisher, or it is known
  std::uint64_t stream_ = 1, answer_stream_ = 0;  // DatedOffset::stream; of the last answer
  Renewal renewed_, renewed_before_;  // by the last offset that was sent, and by the one before
  // Steady clock: until when the drive may still have an offset that this class does not know.
  std::int64_t silent_until_ns_ = 0;
  std::int64_t left_ns_ = 0, leaves_until_ns_ = 0;    // steady clock, of the last answer
  std::int64_t cycle_ns_, held_ns_, surely_gone_ns_;  // after an offset was sent
  std::int64_t gate_ns_ = 0;                          // the gates' clock
  std::int64_t came_ns_ = 0;                          // the last frame, steady clock
  Lateness lateness_{cycle_ns_};
  int unanswered_ = 0;  // frames since the last answer, while a run is active
  Phase phase_ = Phase::kNone;
  Run run_;
  // The row at which the commands of the run are, counted by sequence numbers, also while the
  // offset fades; none: they have left the program.
  std::optional<Eigen::Index> counted_row_;
  std::uint64_t counted_sequence_ = 0;
  std::vector<std::size_t> path_;  // linear axes of the run, indices in the program
  ContourError contour_{2};
  std::array<PathPoint, kMaxLookAhead> ahead_{};
  std::array<double, kMaxAxes> nominal_{};
  std::array<double, kMaxAxes> added_{}, added_before_{};  // by the drives, if all was delivered
  std::vector<MachineOffset> sent_;  // of the last delay_cycles cycles, and one before
  std::size_t newest_ = 0;           // of sent_
  MachineFrame seen_;
  MachineOffset offset_;
};

}  // namespace servotwin::daemon
