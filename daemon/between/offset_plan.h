// The corrections that may be applied live, as the learning worker hands them to the real-time
// loop, and the rules by which the loop applies them.
//
// Positions in the axes' own units [m | rad]; times in ns. Errors: none.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "daemon/between/latest_value.h"
#include "daemon/between/offset_run.h"
#include "daemon/between/ring.h"
#include "drivers/common/messages.h"
#include "ilc/gate.h"
#include "ilc/learn.h"

namespace servotwin::daemon {

/// The commanded path of a program, one row per cycle.
struct CommandedPath {
  std::string name;
  std::uint64_t revision = 0;
  bool learn = false;                   ///< false: preview only
  std::vector<std::size_t> axes;        ///< indices of the machine's axes
  std::vector<Eigen::ArrayXd> command;  ///< of each of them, one value per cycle [m | rad]

  [[nodiscard]] Eigen::Index rows() const { return command.front().size(); }
};

/// A program and the correction that was learned for it (daemon/correct/learned_program.h).
struct LearnedProgram {
  std::uint64_t number = 0;  ///< assigned by the learning worker
  CommandedPath program;
  /// Residual of each axis' model on held-out data, in the order of program.axes, RMS and maximum
  /// [m | rad]; 0: not known.
  std::vector<double> holdout_rms, holdout_max;
  std::vector<AxisCorrectionFigures> axes;  ///< in the order of program.axes
  std::vector<Eigen::ArrayXd> offset;       ///< of each axis, per cycle; 0 if not learned
  std::vector<Eigen::ArrayXd> error_before, error_after;  ///< predicted tracking error
  Eigen::ArrayXd contour_before, contour_after;           ///< predicted [m]; empty without a path
  ErrorSize contour_size_before, contour_size_after;
  std::int64_t created_ns = 0;
  std::int64_t validated_ns = 0;   ///< validation time of the model that was validated longest ago
  std::string summary;             ///< predicted result, one line for people
  std::vector<std::string> notes;  ///< remarks for people, one line each
  std::string why_not_live;        ///< why it must not be sent to drives; empty: it may
};

/// How offsets are applied: the part of the configuration that the loop needs.
struct OffsetRules {
  double cycle_s = 0.0;
  std::vector<GateLimits> limits;  ///< of every axis of the machine; zeros: no offset is sent
  double ramp_s = 0.0;             ///< fade-in time from 0 to the full offset, and fade-out time
  double validity_s = 0.0;         ///< time before which no drive drops an offset
  double drive_timeout_s = 0.0;    ///< time by which it has certainly begun to; 0: validity_s
  double drive_ramp_s = 0.0;       ///< time within which it then brings the offset to 0
  double match_tolerance = 0.0;    ///< deviation of a command from its program row [m | rad]
  double residual_band = 0.0;      ///< in the larger of two standard deviations; beyond: fade out
  int delay_cycles = 1;            ///< from a frame to the cycle that applies its offset; >= 1
  bool live = false;               ///< false: dry run, even when armed
  bool in_command = false;         ///< the frames' command contains the offset
};

/// The longest time in which an offset fades to 0 while every frame is answered: within the ramp,
/// and no faster than the limit of the rate.
[[nodiscard]] inline double fade_out_s(const OffsetRules& rules) noexcept {
  double longest = rules.ramp_s;
  for (const GateLimits& limits : rules.limits) {
    if (limits.rate > 0.0) longest = std::max(longest, limits.peak / limits.rate);
  }
  return longest;
}

/// The corrections that may be applied live. The learning worker keeps a plan until the loop uses a
/// newer one.
struct OffsetPlan {
  std::uint64_t generation = 0;
  std::int64_t wall_ns = 0;                                     ///< time of the hand-over
  std::vector<std::shared_ptr<const LearnedProgram>> programs;  ///< at most kMaxPrograms
  bool renewed = false;  ///< same programs as before with a later validation: programs that were
                         ///< given up stay barred
};

/// An offset on its way to the network.
struct DatedOffset {
  MachineOffset offset;
  std::int64_t leaves_until_ns = 0;  ///< steady clock; later it must not be sent
  /// > 0: reaches a drive on this way. If one does not leave in time, no later one of this stream
  /// may leave. 0: no drive depends on it.
  std::uint64_t stream = 0;
};

/// Everything that the loop and the other threads share about corrections. It outlives both.
struct OffsetHandOver {
  explicit OffsetHandOver(bool to_publisher = false) : by_publisher(to_publisher) {}

  LatestValue<const OffsetPlan*> plans;
  std::atomic<std::uint64_t> in_use{0};  ///< generation of the plan that the loop uses
  std::atomic<bool> armed{false};        ///< by a person; not kept over a restart
  std::atomic<bool> active{false};       ///< a run has not faded out yet; written by the loop
  const bool by_publisher;               ///< drives get offsets from the publisher
  /// DatedOffset::stream of which an offset did not leave in time; written by the publisher. The
  /// loop has understood when offsets of a later stream come.
  std::atomic<std::uint64_t> interrupted{0};
  /// Another daemon is active for the machine: its offsets are the ones that drives receive.
  /// Written by the publisher.
  std::atomic<bool> standby{false};
  Ring<OffsetRun> runs{16};
};

}  // namespace servotwin::daemon
