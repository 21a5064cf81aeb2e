// The daemon on a machine whose axes push each other: it finds the coupling in the background, and
// its loop predicts with it. The machine shares no code with the twin.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <sstream>
#include <vector>

#include "daemon/identify/identification_worker.h"
#include "daemon/loop/real_time_loop.h"
#include "tests/daemon/support.h"
#include "tests/support/coupled_machine.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;

/// The machine of tests/support/coupled_machine.h, of which the daemon sees the frames.
class CoupledAxes : public testing::Test {
 protected:
  CoupledAxes() {
    const auto axes = test::recorded(test::coupled_machine(0.0), test::production_of_both());
    machine_.cycle_s = axes[0].sample_time_s;
    for (const SegmentedAxis& axis : axes) {
      machine_.axes.push_back({axis.axis, false, ""});
      record_.push_back(axis.segments[0]);
    }
    config_.window_s = 8.0;
    config_.memory_s = 16.0;
    config_.judge_s = 3.0;
    config_.options.order = 2;
    config_.options.friction = kind_of<Presliding>();
  }
  [[nodiscard]] MachineFrame frame(Eigen::Index k) const {
    MachineFrame out;
    out.sequence = static_cast<std::uint64_t>(k);
    out.time_ns = std::llround(1e9 * machine_.cycle_s * static_cast<double>(k));
    out.axis_count = 2;
    for (std::size_t i = 0; i < 2; ++i)
      out.axes[i] = {record_[i].command(k), record_[i].actual(k), kAbsent};
    return out;
  }
  /// RMS of what the loop does not predict of Y, over the last quarter of the record [m], after the
  /// worker has seen all of it.
  double residual_of_y() {
    MotionMemory memory(machine_, 100.0);
    Store store(directory_.path(), config_.options.coupling ? "with" : "without");
    EventLog events(store, said_);
    std::vector<LatestValue<TwinInForce>> models(2);
    models_.clear();
    IdentificationWorker worker(machine_, config_, memory, store, events, models,
                                [&](const StoredModel& model) { models_.push_back(model.record); });
    const Eigen::Index rows = record_[0].size();
    for (Eigen::Index k = 0; k < rows; ++k) {
      const MachineFrame one = frame(k);
      CycleRow row;
      row.time_ns = one.time_ns;
      row.after_gap = k == 0;
      row.axis_count = 2;
      row.axes = one.axes;
      memory.append(row);
    }
    worker.finish();
    Ring<MachinePrediction> predictions{16};
    Ring<CycleRow> out{16};
    const WakeUp wake_up;
    RealTimeLoop loop(machine_.cycle_s, models, predictions, out, wake_up);
    double sum = 0.0, count = 0.0;
    for (Eigen::Index k = 0; k < rows; ++k) {
      loop.on_frame(frame(k), {});
      MachinePrediction prediction;
      EXPECT_TRUE(predictions.pop(prediction));
      if (k < rows - rows / 4) continue;
      sum += prediction.axes[1].residual * prediction.axes[1].residual;
      count += 1.0;
    }
    return std::sqrt(sum / count);
  }

  TemporaryDirectory directory_;
  MachineDescription machine_;
  std::vector<Segment> record_;
  IdentifyConfig config_;
  std::ostringstream said_;
  std::vector<ModelRecord> models_;
};

TEST_F(CoupledAxes, AreFoundInTheBackgroundAndPredictedLive) {
  config_.options.coupling = true;
  const double with = residual_of_y();
  ASSERT_FALSE(models_.empty()) << said_.str();
  for (const ModelRecord& record : models_) {
    EXPECT_NE(record.model.find(kind_of<CrossCoupling>()), nullptr) << record.axis;
    EXPECT_EQ(record.neighbour, record.axis == "X" ? "Y" : "X");
  }
  config_.options.coupling = false;
  const double without = residual_of_y();
  std::printf("live residual of Y: %.3f um with what X does, %.3f um without\n", 1e6 * with,
              1e6 * without);
  EXPECT_LT(2.0 * with, without) << said_.str();
}

}  // namespace
}  // namespace servotwin::daemon
