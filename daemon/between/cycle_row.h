// What the real-time loop takes and gives, cycle by cycle: the twin in force of an axis, and the
// row that is recorded. Trivially copyable: they cross threads by value (latest_value.h, ring.h).
//
// Linear axes in m, rotary axes in rad; a number that is not there is NaN. Errors: none.
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
  int settling_cycles = 0;              ///< until a wrong starting state is forgotten
};

/// One cycle of an axis as the alarm sees it.
struct LiveResidual {
  double residual = kAbsent;     ///< measured - predicted, NaN where nothing is predicted
  double holdout_rms = kAbsent;  ///< of the model in force
  int model_version = 0;         ///< 0: none
};

/// One cycle as it is recorded, and what the twins left of it.
struct CycleRow {
  std::int64_t time_ns = 0;  ///< stamp of the frame
  bool after_gap = true;     ///< the cycle before is not the row before
  int axis_count = 0;
  std::array<AxisSample, kMaxAxes> axes{};
  std::array<LiveResidual, kMaxAxes> residuals{};  ///< NaN but for AxisState::kPredicting
};

}  // namespace servotwin::daemon
