// Live cycles of a twentieth of a second, as points for the charts of the page.
//
// Up to kMaxPointsPerSecond points per second over all axes, a point is one cycle. Beyond that, a
// point covers several cycles: it has the value of the last cycle and the minimum and maximum of
// all, so that no peak is lost. A batch ends early at a gap in the cycles.
//
// Errors and commands [m | rad]. Pure: no clock. One thread.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "drivers/common/messages.h"

namespace servotwin::daemon {

/// One quantity, one value per point; a missing value is NaN.
struct LiveSeries {
  std::vector<double> value;            ///< of the last cycle of the point
  std::vector<double> least, greatest;  ///< of all its cycles; empty if a point is one cycle
};

struct LiveAxisBatch {
  LiveSeries command, measured, predicted, residual;
  std::int32_t model_version = 0;  ///< at the last cycle
  AxisState state = AxisState::kNoModel;
};

struct LiveBatch {
  std::uint64_t first_sequence = 0;
  std::int64_t first_time_ns = 0;  ///< stamp of the first cycle
  double point_s = 0.0;            ///< time between two points
  int cycles_per_point = 1;
  bool after_gap = true;  ///< cycles are missing between the batch before and this one
  std::vector<LiveAxisBatch> axes;
  LiveSeries contour, measured_contour;
};

class LiveBatcher {
 public:
  static constexpr double kBatch_s = 0.05;
  static constexpr double kMaxPointsPerSecond = 8000.0;  // per second, over all axes

  LiveBatcher(double cycle_s, std::size_t axes);

  /// Adds the next cycle; returns a batch if that completes it, or ends it by a gap.
  std::optional<LiveBatch> add(const MachinePrediction& cycle);
  /// The incomplete batch, if there is one.
  std::optional<LiveBatch> flush();

 private:
  void begin(const MachinePrediction& cycle);
  void put(const MachinePrediction& cycle);

  double cycle_s_;
  int cycles_per_point_;
  int cycles_per_batch_;
  LiveBatch batch_;
  int cycles_ = 0;  // in it
  std::uint64_t last_sequence_ = 0;
  bool any_ = false;
};

}  // namespace servotwin::daemon
