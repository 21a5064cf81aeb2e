// The data that the real-time loop exchanges with other threads: the twin in force of an axis
// (input) and the recorded row of a cycle (output). All types are trivially copyable and cross
// threads by value (latest_value.h, ring.h).
//
// Linear axes in m, rotary axes in rad; a missing number is NaN. Errors: none.
#pragma once

#include <array>
#include <cstdint>

#include "twin/sample.h"
#include "twin/twin.h"

namespace servotwin::daemon {

/// A model as the loop uses it.
struct TwinInForce {
  Twin twin;
  int version = 0;
  double standard_deviation = kAbsent;  ///< hold-out RMS [m | rad]
  int settling_cycles = 0;              ///< until a wrong initial state has decayed to 1 %
  int neighbour = -1;                   ///< the axis whose acceleration acts on this one; -1: none
  bool by_motion = false;               ///< by its predicted motion, not by its command
};

/// The residual of one axis in one cycle: the input of the residual alarm.
struct LiveResidual {
  double residual = kAbsent;     ///< measured - predicted, NaN where nothing is predicted
  double holdout_rms = kAbsent;  ///< of the model in force
  int model_version = 0;         ///< 0: none
};

/// One cycle as it is recorded, with the residuals of its axes.
struct CycleRow {
  std::int64_t time_ns = 0;  ///< stamp of the frame
  bool after_gap = true;     ///< cycles or rows are missing before this one
  int axis_count = 0;
  std::array<AxisSample, kMaxAxes> axes{};
  std::array<LiveResidual, kMaxAxes> residuals{};  ///< NaN unless AxisState::kPredicting
};

}  // namespace servotwin::daemon
