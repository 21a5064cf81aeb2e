// Which step of identification the worker runs for which motion, on a virtual axis whose physics
// shares no code with the twin.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>

#include "daemon/identify/identification_worker.h"
#include "tests/daemon/support.h"
#include "tests/virtual_machine/axis.h"
#include "tests/virtual_machine/program.h"
#include "twin/twin.h"

namespace servotwin::daemon {
namespace {

using testing::AllOf;
using testing::AnyOf;
using testing::Contains;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;

namespace vm = virtual_machine;

constexpr vm::Limits kRapid{.velocity = 0.25, .acceleration = 3.0, .jerk = 60.0};
constexpr vm::Limits kSlow{.velocity = 0.003, .acceleration = 0.05, .jerk = 5.0};

/// P-P drive on a ball screw with presliding over 60 um, read with a step of 0.5 um.
vm::Axis machine() {
  vm::Axis axis;
  axis.body.mass = 100.0;
  axis.body.viscous = 240.0;
  axis.body.friction = vm::gms_with_curve(60.0, 60e-6, 3.0, 10);
  axis.drive.position_gain = 60.0;
  axis.drive.velocity_gain = 20'000.0;
  axis.recorder.position_step = 5e-7;
  return axis;
}

/// Strokes at rapid feed rate for at least this long.
void move_fast(vm::Trajectory& trajectory, double seconds) {
  const double end_s = trajectory.duration() + seconds;
  for (int i = 0; trajectory.duration() < end_s; ++i)
    trajectory.move_to(trajectory.end_position() + (i % 2 == 0 ? 0.03 : -0.025), kRapid);
}

/// Reversals of different lengths, from the breakaway displacement upwards.
void reverse_slowly(vm::Trajectory& trajectory, double seconds) {
  const double end_s = trajectory.duration() + seconds;
  constexpr std::array<double, 4> kLegs{600e-6, -250e-6, 200e-6, -550e-6};
  for (std::size_t i = 0; trajectory.duration() < end_s; ++i)
    trajectory.move_to(trajectory.end_position() + kLegs[i % kLegs.size()], kSlow);
}

class StepsTest : public testing::Test {
 protected:
  StepsTest() {
    config_.window_s = 6.0;
    config_.memory_s = 12.0;
    config_.judge_s = 3.0;
    config_.options.order = 2;
    config_.options.delay_max_s = 0.0;
    config_.options.method = Method::kPoleSearch;
  }
  void start() {
    memory_ = std::make_unique<MotionMemory>(machine_, 60.0);
    store_ = std::make_unique<Store>(directory_.path(), "mill");
    events_ = std::make_unique<EventLog>(*store_, said_);
    worker_ = std::make_unique<IdentificationWorker>(
        machine_, config_, *memory_, *store_, *events_, in_force_,
        [this](const StoredModel& model) { announced_.push_back(model); });
  }
  /// The machine runs this program from rest; the worker processes all of its motion.
  void run(const vm::Trajectory& program) {
    const vm::AxisRecord record = vm::record(machine(), program);
    for (Eigen::Index i = 0; i < record.command.size(); ++i)
      cycle(record.command(i), record.actual(i));
  }
  void cycle(double command, double actual) {
    CycleRow row;
    row.time_ns = row_ * 1'000'000;
    row.after_gap = row_ == 0;
    row.axis_count = 1;
    row.axes[0] = last_ = {command, actual, kAbsent};
    memory_->append(row);
    if (++row_ % 250 != 0) return;
    while (worker_->look(0)) {
    }
  }
  /// The axis stands still, with noise on the encoder.
  void stand(double seconds, double noise) {
    const AxisSample at = last_;
    for (int i = 0; i < static_cast<int>(seconds / kCycle_s); ++i)
      cycle(at.command, at.actual + noise * std::normal_distribution<>()(random_));
  }
  /// The steps of the worker, in order.
  [[nodiscard]] std::vector<std::string> steps() const {
    std::vector<std::string> out;
    for (const Event& event : store_->events(1000)) {
      if (event.kind == "identification_step" || event.kind == "noise_floor")
        out.insert(out.begin(), event.text);
    }
    return out;
  }
  [[nodiscard]] std::string activity() const {
    std::vector<AxisStatus> all;
    worker_->update(all);
    return all.at(0).activity;
  }

  TemporaryDirectory directory_;
  MachineDescription machine_ = one_axis();
  IdentifyConfig config_;
  std::vector<LatestValue<TwinInForce>> in_force_{1};
  std::vector<StoredModel> announced_;
  std::ostringstream said_;
  std::unique_ptr<MotionMemory> memory_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<EventLog> events_;
  std::unique_ptr<IdentificationWorker> worker_;
  AxisSample last_;
  std::int64_t row_ = 0;
  std::mt19937_64 random_{7};
};

TEST_F(StepsTest, FastMotionThenSlowReversalsThenStandstillEachGetTheirStep) {
  config_.options.method = Method::kJoint;
  config_.options.friction = kind_of<Presliding>();  // which one it is takes longer
  start();
  vm::Trajectory program;
  move_fast(program, 6.2);
  reverse_slowly(program, 10.0);
  program.dwell(14.0);
  run(program);
  EXPECT_THAT(
      steps(),
      ElementsAre(StartsWith("loop and friction on 6.0 s of fast motion and 0.0 s of slow "
                             "reversals: no model is in force"),
                  AllOf(StartsWith("friction on "),
                        HasSubstr("s of slow reversals are new, fast motion is not; starting "
                                  "from model 1"))));
  EXPECT_THAT(activity(), HasSubstr("standstill: noise floor of model 2 "));
  ASSERT_EQ(announced_.size(), 2U) << said_.str();

  // On held-out reversals, against the position without encoder quantisation.
  vm::Trajectory later;
  reverse_slowly(later, 8.0);
  const vm::AxisRecord record = vm::record(machine(), later);
  const Eigen::ArrayXd truth = record.command - record.true_position;
  const Segment unseen{0.0, kCycle_s, record.command, record.actual, {}, {}, {}, false, {}};
  const auto left = [&](const Model& model) {
    return std::sqrt((truth - simulate(model, unseen)).square().mean());
  };
  EXPECT_LT(left(announced_[1].record.model), 0.8 * left(announced_[0].record.model));
}

TEST_F(StepsTest, FastMotionBeyondTheMotionMemoryHoldsTheLoopStill) {
  start();
  vm::Trajectory program;
  move_fast(program, 6.2);
  reverse_slowly(program, 26.0);
  run(program);
  const std::vector<std::string> done = steps();
  ASSERT_GE(done.size(), 4U) << said_.str();
  for (std::size_t i = 1; i < done.size(); ++i)
    EXPECT_THAT(done[i], StartsWith("friction on 6.7 s of fast motion and "));
  // After 24 s with a memory of 12 s: of slow reversals at most half of it is kept.
  EXPECT_THAT(done.back(), HasSubstr(" and 6.0 s of slow reversals"));
}

TEST_F(StepsTest, NewFastMotionIsAReasonToSeekTheLoopAgain) {
  start();
  vm::Trajectory program;
  move_fast(program, 6.2);
  reverse_slowly(program, 6.0);
  move_fast(program, 6.0);
  run(program);
  EXPECT_THAT(steps(), ElementsAre(StartsWith("loop and friction on "), StartsWith("friction on "),
                                   AllOf(StartsWith("loop and friction on "),
                                         HasSubstr(" s of fast motion are new"))));
}

// The model in force has order 3; full identifications find order 2.
TEST_F(StepsTest, FrictionIsSoughtInTheStructureOfTheModelInForce) {
  vm::Trajectory program;
  move_fast(program, 9.2);
  const vm::AxisRecord before = vm::record(machine(), program);
  IdentifyOptions third = config_.options;
  third.order = 3;
  SegmentedAxis axis;
  axis.axis = "X";
  axis.sample_time_s = kCycle_s;
  axis.segments = {{0.0, kCycle_s, before.command, before.actual, {}, {}, {}, false, {}}};
  const Model model = identify(axis, third).record.model;
  ASSERT_EQ(model.loop.order, 3);
  config_.min_improvement = 0.9;  // nothing is that much better, so that it stays in force
  start();
  ModelRecord record = record_of(model);
  store_->promote(record, {"2026-01-31T12:00:00.000Z", "X", "model_promoted", "", ""});
  worker_->restore();
  reverse_slowly(program, 10.0);
  run(program);
  std::vector<int> orders;
  for (const Event& event : store_->events(1000)) {
    if (event.kind == "model_refused" && !event.detail.empty())
      orders.push_back(model_from_json(nlohmann::json::parse(event.detail)).model.loop.order);
  }
  EXPECT_THAT(steps(), ElementsAre(StartsWith("loop and "), StartsWith("loop and "),
                                   StartsWith("friction on ")));
  EXPECT_THAT(orders, ElementsAre(3, 2, 2)) << "the newest first\n" << said_.str();
}

// Of a spring slow reversals show little, and a start from a model is one of a rigid axis.
TEST_F(StepsTest, SlowReversalsAreNoReasonForAStepWithTwoMassesInForce) {
  config_.min_improvement = 0.9;  // nothing is that much better, so that they stay in force
  start();
  Model model = drive();
  model.effects.push_back(make_effect<TwoMassMotorEncoder>());
  ModelRecord record = record_of(model);
  store_->promote(record, {"2026-01-31T12:00:00.000Z", "X", "model_promoted", "", ""});
  worker_->restore();
  vm::Trajectory program;
  move_fast(program, 6.2);
  reverse_slowly(program, 10.0);
  run(program);
  EXPECT_THAT(steps(), Not(Contains(StartsWith("friction on ")))) << said_.str();
  EXPECT_THAT(activity(), HasSubstr("no step: two masses are identified from fast motion"));
}

TEST_F(StepsTest, SteadyMotionIsNoReasonForAnyStep) {
  start();
  vm::Trajectory program;
  move_fast(program, 6.2);
  program.move_to(program.end_position() + 0.03, kSlow);
  run(program);
  EXPECT_EQ(steps().size(), 1U) << said_.str();
  EXPECT_THAT(activity(),
              HasSubstr("no step: there is no new fast motion and no new slow reversal"));
}

TEST_F(StepsTest, AStandingAxisShowsItsNoiseAndNothingIsSought) {
  start();
  vm::Trajectory program;
  move_fast(program, 9.5);
  program.dwell(1.0);
  run(program);
  ASSERT_EQ(announced_.size(), 1U) << said_.str();
  const std::size_t before = steps().size();
  stand(13.0, 5e-6);
  EXPECT_EQ(steps().size(), before + 1) << said_.str();
  EXPECT_THAT(steps().back(), AnyOf(StartsWith("standstill: noise floor of model 1 4.9"),
                                    StartsWith("standstill: noise floor of model 1 5.0")));
  EXPECT_THAT(steps().back(), HasSubstr(" um, no fit, was 0."));
  EXPECT_EQ(announced_.size(), 1U);
}

}  // namespace
}  // namespace servotwin::daemon
