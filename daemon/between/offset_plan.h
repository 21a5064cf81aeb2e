// The corrections that may be given back, as the learning worker hands them to the real-time loop,
// and the rules by which the loop gives them back.
//
// Positions in the axes' own units [m | rad]; times in ns. Errors: none.
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "daemon/between/latest_value.h"
#include "daemon/between/offset_run.h"
#include "daemon/between/ring.h"
#include "drivers/messages.h"
#include "ilc/gate.h"
#include "ilc/learn.h"

namespace servotwin::daemon {

/// A program's path, one row per cycle.
struct CommandedPath {
  std::string name;
  std::uint64_t revision = 0;
  bool learn = false;                   ///< false: preview only
  std::vector<std::size_t> axes;        ///< of the machine, by number
  std::vector<Eigen::ArrayXd> command;  ///< of each of them, one value per cycle [m | rad]

  [[nodiscard]] Eigen::Index rows() const { return command.front().size(); }
};

/// A program and the correction that was learned for it (daemon/correct/learned_program.h).
struct LearnedProgram {
  std::uint64_t number = 0;  ///< of whoever keeps it
  CommandedPath program;
  /// Of each axis' model on its hold-out, as program.axes, RMS and MAX [m | rad]; 0: not known.
  std::vector<double> missed, missed_most;
  std::vector<AxisCorrectionFigures> axes;  ///< as program.axes
  std::vector<Eigen::ArrayXd> offset;       ///< of each of them; 0 if it was not learned
  std::vector<Eigen::ArrayXd> error_before, error_after;  ///< predicted, against the command
  Eigen::ArrayXd contour_before, contour_after;           ///< predicted [m]; empty without a path
  ErrorSize contour_size_before, contour_size_after;
  std::int64_t created_ns = 0;
  std::int64_t validated_ns = 0;   ///< when the one of its models was that was so the longest ago
  std::string summary;             ///< what came of it, one line for people
  std::vector<std::string> notes;  ///< what people should know of it, a line each
  std::string why_not_live;        ///< why it must not be sent to drives; empty: it may
};

/// How offsets are given back: what the loop must know of the configuration.
struct OffsetRules {
  double cycle_s = 0.0;
  std::vector<GateLimits> limits;  ///< of every axis of the machine; zeros: nothing goes out
  double ramp_s = 0.0;             ///< from nothing to the whole offset, and back
  double validity_s = 0.0;         ///< after which a drive must drop an offset
  double match_tolerance = 0.0;    ///< of a command that belongs to a program [m | rad]
  double residual_band = 0.0;      ///< standard deviations; beyond it offsets fade out
  int delay_cycles = 1;            ///< from a frame to the cycle that applies its offset; >= 1
  bool live = false;               ///< false: offsets are advice, whoever arms them
  bool in_command = false;         ///< the frames' command has the offset in it
};

/// The corrections that may be given back, as the worker hands them over. It is kept until the loop
/// has taken a newer one.
struct OffsetPlan {
  std::uint64_t generation = 0;
  std::int64_t wall_ns = 0;                                     ///< when it was handed over
  std::vector<std::shared_ptr<const LearnedProgram>> programs;  ///< at most kMaxPrograms
  bool renewed = false;  ///< as the one before, only validated later: what was given up stays so
};

/// What lies between the loop and the others. It outlives both.
struct OffsetHandOver {
  LatestValue<const OffsetPlan*> plans;
  std::atomic<std::uint64_t> in_use{0};  ///< generation of the plan that the loop has taken
  std::atomic<bool> armed{false};        ///< by a person; not remembered
  Ring<OffsetRun> runs{16};
};

}  // namespace servotwin::daemon
