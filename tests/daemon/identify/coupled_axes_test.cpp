// The daemon on a machine whose axes push each other: it finds the coupling in the background, and
// its loop predicts with it. The machine shares no code with the twin.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <map>
#include <optional>
#include <sstream>
#include <vector>

#include "daemon/identify/held_out.h"
#include "daemon/identify/identification_worker.h"
#include "daemon/loop/real_time_loop.h"
#include "tests/daemon/support.h"
#include "tests/support/coupled_machine.h"

namespace servotwin::daemon {
namespace {

/// The machine of tests/support/coupled_machine.h, of which the daemon sees the frames.
class CoupledAxes : public testing::Test {
 protected:
  explicit CoupledAxes(const test::CoupledMachine& machine = test::coupled_machine(0.0),
                       double seconds = 20.0) {
    const auto axes = test::recorded(machine, test::production_of_both(seconds));
    machine_.cycle_s = axes[0].sample_time_s;
    for (const SegmentedAxis& axis : axes) {
      machine_.axes.push_back({axis.axis, false, ""});
      record_.push_back(axis.segments[0]);
    }
    config_.window_s = 8.0;
    config_.memory_s = 16.0;
    config_.judge_s = 3.0;
    config_.options.order = 2;
    config_.options.coupling = true;
    config_.options.modes = 1;  // X has a spring
    config_.options.friction = kind_of<Presliding>();
  }
  /// Another axis, before Y, which moves as Y did two seconds before and touches nobody.
  void put_in_an_axis_that_touches_nobody() {
    Segment other = record_[1];
    const Eigen::Index n = other.size(), late = std::lround(2.0 / machine_.cycle_s);
    other.command.head(late).setConstant(record_[1].command(0));
    other.command.tail(n - late) = record_[1].command.head(n - late);
    other.actual = other.command;
    record_.insert(record_.begin() + 1, std::move(other));
    machine_.axes.insert(machine_.axes.begin() + 1, {"A", false, ""});
  }
  [[nodiscard]] MachineFrame frame(Eigen::Index k) const {
    MachineFrame out;
    out.sequence = static_cast<std::uint64_t>(k);
    out.time_ns = std::llround(1e9 * machine_.cycle_s * static_cast<double>(k));
    out.axis_count = static_cast<int>(record_.size());
    for (std::size_t i = 0; i < record_.size(); ++i)
      out.axes[i] = {record_[i].command(k), record_[i].actual(k), kAbsent};
    return out;
  }
  /// Lets the worker look at X for as long as it has something to do, after all rows.
  void identify_x() { identify(1); }
  /// The same with the first `count` axes in turn.
  void identify(std::size_t count) {
    MotionMemory memory(machine_, 100.0);
    Store store(directory_.path(), "coupled");
    EventLog events(store, said_);
    std::vector<LatestValue<TwinInForce>> models(record_.size());
    IdentificationWorker worker(machine_, config_, memory, store, events, models,
                                [&](const StoredModel& model) {
                                  if (model.record.axis == "X") found_ = model.record;
                                  all_[model.record.axis] = model.record;
                                });
    worker.restore();
    for (Eigen::Index k = 0; k < record_[0].size(); ++k) {
      const MachineFrame one = frame(k);
      CycleRow row;
      row.time_ns = one.time_ns;
      row.after_gap = k == 0;
      row.axis_count = one.axis_count;
      row.axes = one.axes;
      memory.append(row);
    }
    for (bool any = true; any;) {
      any = false;
      for (std::size_t axis = 0; axis < count; ++axis) any = worker.look(axis) || any;
    }
  }
  /// RMS of what the loop does not predict of each axis with the models found, over the last
  /// quarter [m].
  [[nodiscard]] std::vector<double> residuals() const {
    std::vector<LatestValue<TwinInForce>> models(record_.size());
    for (std::size_t i = 0; i < models.size(); ++i) {
      const ModelRecord& one = all_.at(machine_.axes[i].name);
      models[i].publish({Twin(one.model), 1, one.holdout.rms, settling_cycles(one.model),
                         neighbour_in(machine_, i, one), coupled_by_motion(one.model)});
    }
    return residuals_of(models);
  }
  /// RMS of what the loop does not predict of X with this model, over the last quarter [m].
  [[nodiscard]] double residual_of_x(int neighbour) const {
    std::vector<LatestValue<TwinInForce>> models(record_.size());
    models[0].publish(
        {Twin(found_->model), 1, found_->holdout.rms, settling_cycles(found_->model), neighbour});
    return residuals_of(models)[0];
  }
  [[nodiscard]] std::vector<double> residuals_of(
      std::vector<LatestValue<TwinInForce>>& models) const {
    Ring<MachinePrediction> predictions{16};
    Ring<CycleRow> rows_out{16};
    const WakeUp wake_up;
    RealTimeLoop loop(machine_.cycle_s, models, predictions, rows_out, wake_up);
    const Eigen::Index rows = record_[0].size(), last = rows / 4;
    std::vector<double> out(models.size());
    for (Eigen::Index k = 0; k < rows; ++k) {
      loop.on_frame(frame(k), {});
      MachinePrediction prediction;
      EXPECT_TRUE(predictions.pop(prediction));
      for (std::size_t i = 0; i < out.size() && k >= rows - last; ++i)
        out[i] += prediction.axes[i].residual * prediction.axes[i].residual;
    }
    for (double& x : out) x = std::sqrt(x / static_cast<double>(last));
    return out;
  }

  /// Identifies both axes, and expects each to be predicted by the motion of the other, to 1.5
  /// times the noise.
  void identify_both_to_the_noise() {
    identify(2);
    ASSERT_EQ(all_.size(), 2u) << said_.str();
    const std::vector<double> left = residuals();
    for (std::size_t i = 0; i < 2; ++i) {
      const ModelRecord& found = all_.at(machine_.axes[i].name);
      EXPECT_TRUE(coupled_by_motion(found.model)) << said_.str();
      std::printf("live residual of %s: %.3f um; identified in %.1f s\n", found.axis.c_str(),
                  1e6 * left[i], found.time_taken_s);
      EXPECT_LT(left[i], 1.5 * 5.8e-8) << found.axis << ": the noise is 0.058 um; " << said_.str();
    }
  }

  TemporaryDirectory directory_;
  MachineDescription machine_;
  std::vector<Segment> record_;
  IdentifyConfig config_;
  std::ostringstream said_;
  std::optional<ModelRecord> found_;        // of X
  std::map<std::string, ModelRecord> all_;  // of every axis
};

TEST_F(CoupledAxes, AreFoundInTheBackgroundAndPredictedLive) {
  identify_x();
  ASSERT_TRUE(found_.has_value()) << said_.str();
  ASSERT_NE(found_->model.find(kind_of<CrossCoupling>()), nullptr) << said_.str();
  EXPECT_EQ(found_->neighbour, "Y");
  EXPECT_EQ(neighbour_in(machine_, 0, *found_), 1);
  // 4 kg of 30: the table of X is pushed by the acceleration of Y.
  EXPECT_NEAR(found_->model.find(kind_of<CrossCoupling>())->coefficient[0], -0.04 / 0.3,
              0.1 * 0.04 / 0.3);
  const double with = residual_of_x(1), without = residual_of_x(-1);
  std::printf("live residual of X: %.3f um with what Y does, %.3f um without\n", 1e6 * with,
              1e6 * without);
  EXPECT_LT(1.7 * with, without) << "the rest is of a law of friction that is not the machine's";
}

/// Both tables stiff.
test::CoupledMachine stiff_machine() {
  test::CoupledMachine out = test::coupled_machine(0.0);
  out.axes[0].body.spring_frequency_hz = 0.0;
  out.axes[0].drive.position_gain = 60.0;
  out.axes[1].drive.position_gain = 50.0;
  return out;
}
class StiffCoupledAxes : public CoupledAxes {
 protected:
  explicit StiffCoupledAxes(double seconds = 20.0) : CoupledAxes(stiff_machine(), seconds) {
    config_.options.modes = 0;
    config_.window_s = 6.0;
    config_.memory_s = 12.0;
  }
};

// First by the command of the other axis, which has no model yet; then by its predicted motion.
TEST_F(StiffCoupledAxes, ArePredictedTogetherFromCommandsAlone) {
  identify(2);
  ASSERT_EQ(all_.size(), 2u) << said_.str();
  const std::vector<double> left = residuals();
  for (std::size_t i = 0; i < 2; ++i) {
    const ModelRecord& found = all_.at(machine_.axes[i].name);
    EXPECT_EQ(found.version, 2) << said_.str();
    ASSERT_TRUE(coupled_by_motion(found.model)) << said_.str();
    constexpr double kTruth = -4.0 / 100.0;  // 4 kg of 100
    EXPECT_NEAR(coupling_of(found.model)->coefficient[0], kTruth, 0.15 * std::abs(kTruth));
    std::printf("live residual of %s: %.3f um\n", found.axis.c_str(), 1e6 * left[i]);
    EXPECT_LT(left[i], 1.5e-7) << found.axis << ", at a noise of 0.058 um";
  }
}

// With the machine's law of friction, for which 20 s are too short.
class LongStiffCoupledAxes : public StiffCoupledAxes {
 protected:
  LongStiffCoupledAxes() : StiffCoupledAxes(40.0) {
    config_.options.friction = kind_of<MaxwellSlip>();
    config_.memory_s = 32.0;
  }
};

TEST_F(LongStiffCoupledAxes, ArePredictedTogetherToTheNoise) { identify_both_to_the_noise(); }

// X on a spring, Y stiff; the law of friction is compared as well.
class LongCoupledAxes : public CoupledAxes {
 protected:
  LongCoupledAxes() : CoupledAxes(test::coupled_machine(0.0), 40.0) {
    config_.options.friction.reset();
    config_.options.bounds.zeta_max = 3.0;  // Y has 2.2
    config_.memory_s = 32.0;                // Y reverses slowly only after 30 s
  }
};

TEST_F(LongCoupledAxes, ArePredictedTogetherToTheNoise) {
  identify_both_to_the_noise();
  for (const auto& [axis, found] : all_)
    EXPECT_NE(found.model.find(kind_of<MaxwellSlip>()), nullptr) << axis << ": the machine's law";
}

// The first other axis is not the one that pushes: what the first model leaves tells which it is.
TEST_F(CoupledAxes, OfThreeTheOneThatPushesIsFound) {
  put_in_an_axis_that_touches_nobody();
  config_.window_s = 6.0;
  identify_x();
  EXPECT_NE(said_.str().find("the acceleration of Y explains"), std::string::npos) << said_.str();
  ASSERT_TRUE(found_.has_value()) << said_.str();
  ASSERT_NE(found_->model.find(kind_of<CrossCoupling>()), nullptr) << said_.str();
  EXPECT_EQ(found_->neighbour, "Y");
  EXPECT_EQ(neighbour_in(machine_, 0, *found_), 2);
  EXPECT_LT(1.5 * residual_of_x(2), residual_of_x(-1));
}

// After a restart, and after a model by hand, the coupling that is in force is sought on.
TEST_F(CoupledAxes, AfterARestartTheAxisInForceIsSought) {
  put_in_an_axis_that_touches_nobody();
  {
    Store store(directory_.path(), "coupled");
    ModelRecord record = record_of(drive());
    record.model.sample_time_s = machine_.cycle_s;
    record.model.effects.push_back(make_effect<CrossCoupling>());
    record.neighbour = "Y";
    store.promote(record, {record.created, "X", "model_promoted", "made for this test", ""});
  }
  identify_x();
  EXPECT_EQ(said_.str().find("it is sought from here on"), std::string::npos) << said_.str();
  ASSERT_TRUE(found_.has_value());
  EXPECT_GT(found_->version, 1) << said_.str();
  ASSERT_NE(found_->model.find(kind_of<CrossCoupling>()), nullptr) << said_.str();
  EXPECT_EQ(found_->neighbour, "Y");
}

// Each model has the axis beside it that it is coupled to.
TEST_F(CoupledAxes, AModelIsJudgedWithTheAxisThatItIsCoupledTo) {
  ModelRecord to_y = record_of(drive());
  to_y.model.sample_time_s = machine_.cycle_s;
  to_y.model.effects.push_back(make_effect<CrossCoupling>());
  to_y.model.effects.back().coefficient[0] = 0.2;
  Segment beside_y = record_[0], beside_nobody = record_[0];
  beside_nobody.neighbour.setZero();
  Candidacy same, unlike;
  (void)judge_on({beside_y}, to_y.model, {beside_y}, &to_y.model, same);
  EXPECT_EQ(same.rms, same.rms_in_force);
  (void)judge_on({beside_y}, to_y.model, {beside_nobody}, &to_y.model, unlike);
  EXPECT_EQ(unlike.rms, same.rms);
  EXPECT_NE(unlike.rms_in_force, same.rms);
  EXPECT_THROW((void)judge_on({beside_y}, to_y.model, {}, &to_y.model, unlike),
               std::invalid_argument);
}

TEST_F(CoupledAxes, AModelThatNeedsAnAxisThatIsNotThereIsRefused) {
  ModelRecord record = record_of(drive());
  record.model.effects.push_back(make_effect<CrossCoupling>());
  EXPECT_EQ(why_not_for(record, machine_, 0), "");
  EXPECT_EQ(neighbour_in(machine_, 1, record), 0);
  record.neighbour = "Z";
  EXPECT_EQ(why_not_for(record, machine_, 0),
            "needs the command of axis 'Z', which the machine does not have");
  machine_.axes.pop_back();
  record.neighbour.clear();
  EXPECT_EQ(why_not_for(record, machine_, 0),
            "needs the command of another axis, which the machine does not have");
}

}  // namespace
}  // namespace servotwin::daemon
