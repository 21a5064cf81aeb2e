// The real-time loop with its rings and models, and frames of a moving machine to put in.
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <vector>

#include "daemon/loop/real_time_loop.h"
#include "tests/daemon/support.h"

namespace servotwin::daemon {

inline TwinInForce twin_in_force(const Model& model, int version = 1) {
  return {Twin(model), version, 1.3e-6, settling_cycles(model)};
}

/// A loop with its rings, and frames to put in.
class LoopWithRings {
 public:
  explicit LoopWithRings(std::size_t axes = 1, std::size_t row_room = 16'384,
                         const std::vector<std::vector<std::size_t>>& paths = {})
      : models(axes), rows(row_room), loop(kCycle_s, models, predictions, rows, wake_up, paths) {}

  [[nodiscard]] MachineFrame frame(std::uint64_t k) const {
    MachineFrame out;
    out.sequence = k;
    out.time_ns = static_cast<std::int64_t>(k) * 1'000'000;
    out.axis_count = static_cast<int>(models.size());
    for (std::size_t i = 0; i < models.size(); ++i) {
      const double command =
          command_at(static_cast<double>(k) * kCycle_s) * static_cast<double>(i + 1);
      out.axes[i] = {command, command - 2e-6, kAbsent};
    }
    return out;
  }
  MachinePrediction put(const MachineFrame& frame) {
    loop.on_frame(frame, {});
    MachinePrediction out;
    EXPECT_TRUE(predictions.pop(out));
    return out;
  }
  MachinePrediction put(std::uint64_t k) { return put(frame(k)); }
  CycleRow newest_row() {
    CycleRow row;
    while (rows.pop(row)) {
    }
    return row;
  }

  std::vector<LatestValue<TwinInForce>> models;
  Ring<MachinePrediction> predictions{16};
  Ring<CycleRow> rows;
  WakeUp wake_up;
  RealTimeLoop loop;
};

}  // namespace servotwin::daemon
