// A twentieth of a second of live cycles, as the page draws them.
//
// Up to kMostPoints points a second over all axes a point is a cycle. Beyond that a point is
// several: its value is that of its last cycle, and the least and the greatest of all of them stand
// beside it, so that no peak is lost. A batch ends early where the cycles do not follow each other.
//
// Errors and commands [m | rad]. Pure: no clock. One thread.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "drivers/messages.h"

namespace servotwin::daemon {

/// One quantity, point by point. What is not there is NaN.
struct LiveSeries {
  std::vector<double> value;            ///< at the last cycle of the point
  std::vector<double> least, greatest;  ///< of its cycles; empty where a point is a cycle
};

struct LiveAxisBatch {
  LiveSeries command, measured, predicted, residual;
  std::int32_t model_version = 0;  ///< at the last cycle
  AxisState state = AxisState::kNoModel;
};

struct LiveBatch {
  std::uint64_t first_sequence = 0;
  std::int64_t first_time_ns = 0;  ///< stamp of the first cycle
  double point_s = 0.0;            ///< from point to point
  int cycles_per_point = 1;
  bool after_gap = true;  ///< the cycle before its first is not the last one of the batch before
  std::vector<LiveAxisBatch> axes;
  LiveSeries contour;
};

class LiveBatcher {
 public:
  static constexpr double kBatch_s = 0.05;
  static constexpr double kMostPoints = 8000.0;  // per second, over all axes

  LiveBatcher(double cycle_s, std::size_t axes);

  /// The next cycle; a batch where that completes one, or does not follow on what there is.
  std::optional<LiveBatch> add(const MachinePrediction& cycle);
  /// What there is, if anything: nothing more may come.
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
