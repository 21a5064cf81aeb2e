#include "daemon/identify/identification_worker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cerrno>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <random>
#include <stop_token>
#include <thread>

#include "tests/daemon/ball_screw.h"
#include "tests/daemon/full_disk.h"
#include "tests/daemon/support.h"
#include "tests/identification/loop/held_by_friction.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;
using testing::MatchesRegex;
using testing::Not;

const virtual_machine::AxisRecord& machine_record() {
  static const virtual_machine::AxisRecord record = ball_screw_record(32.0);
  return record;
}

class WorkerTest : public testing::Test {
 protected:
  WorkerTest() {
    config_.window_s = 6.0;
    config_.memory_s = 12.0;
    config_.judge_s = 3.0;
    config_.options.order = 2;
    config_.options.delay_max_s = 0.0;
    config_.options.method =
        Method::kPoleSearch;  // how a model is found is not the worker's concern
  }

  /// A worker over a store that is opened anew, as after a restart.
  void restart() {
    worker_.reset();
    events_.reset();
    store_.reset();
    memory_ = std::make_unique<MotionMemory>(machine_, remembered_s_);
    store_ = std::make_unique<Store>(directory_.path(), "mill");
    events_ = std::make_unique<EventLog>(*store_, said_);
    worker_ = std::make_unique<IdentificationWorker>(
        machine_, config_, *memory_, *store_, *events_, in_force_,
        [this](const StoredModel& model) { announced_.push_back(model); });
  }

  /// The machine runs until it has moved for this long, the encoder with noise added.
  void run_machine(double moved_s, double noise = 0.0) {
    std::normal_distribution<> normal;
    const double until = memory_->moved_s(0) + moved_s;
    const virtual_machine::AxisRecord& record = machine_record();
    while (memory_->moved_s(0) < until) {
      ASSERT_LT(row_, record.command.size()) << "the record is too short for this test";
      CycleRow row;
      row.time_ns = row_ * 1'000'000;
      row.after_gap = row_ == 0;
      row.axis_count = 1;
      row.axes[0] = {record.command(row_), record.actual(row_) + noise * normal(random_), kAbsent};
      memory_->append(row);
      ++row_;
    }
  }
  void stand(double seconds) {
    const virtual_machine::AxisRecord& record = machine_record();
    for (int i = 0; i < static_cast<int>(seconds / kCycle_s); ++i) {
      CycleRow row;
      row.time_ns = row_++ * 1'000'000;
      row.after_gap = false;
      row.axis_count = 1;
      row.axes[0] = {record.command(0), record.actual(0), kAbsent};
      memory_->append(row);
    }
  }
  /// The first model, promoted on held-out motion.
  void promote_one() {
    run_machine(6.5);
    ASSERT_TRUE(worker_->look(0));
    run_machine(3.5);
    ASSERT_TRUE(worker_->look(0));
    ASSERT_EQ(announced_.size(), 1U) << said_.str();
  }
  [[nodiscard]] AxisStatus status() const {
    std::vector<AxisStatus> all;
    worker_->update(all);
    return all.at(0);
  }
  [[nodiscard]] std::string last_error() const {
    std::string text;
    events_->update_last_error(text);
    return text;
  }
  [[nodiscard]] Event newest_event() const { return store_->events(1).at(0); }

  TemporaryDirectory directory_;
  MachineDescription machine_ = one_axis();
  double remembered_s_ = 100.0;
  IdentifyConfig config_;
  std::vector<LatestValue<TwinInForce>> in_force_{1};
  std::vector<StoredModel> announced_;
  std::ostringstream said_;
  std::unique_ptr<MotionMemory> memory_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<EventLog> events_;
  std::unique_ptr<IdentificationWorker> worker_;
  Eigen::Index row_ = 0;
  std::mt19937_64 random_{20};
};

TEST_F(WorkerTest, DoesNothingUntilTheWindowIsFullOfMotion) {
  restart();
  stand(60.0);
  EXPECT_FALSE(worker_->look(0));
  EXPECT_THAT(status().activity, HasSubstr("collecting: 0.0 of 6.0 s of motion"));
}

TEST_F(WorkerTest, AnIdentificationIsGivenUpWhenTheDaemonStops) {
  restart();
  std::stop_source stop;
  worker_->give_up_with(stop.get_token());
  run_machine(6.5);
  stop.request_stop();
  ASSERT_TRUE(worker_->look(0));
  EXPECT_EQ(newest_event().kind, "identification_given_up") << said_.str();
  EXPECT_EQ(status().refused, 0U) << "nothing is wrong with the motion";
}

TEST_F(WorkerTest, WhileOneAxisIsIdentifiedTheStatusSaysThatOthersAreOnHold) {
  machine_.axes.push_back({"Y", false, ""});
  in_force_ = std::vector<LatestValue<TwinInForce>>(2);
  // Long enough to be seen: with modes, and stopped when it has been.
  config_.options.method = Method::kJoint;
  config_.options.modes = 3;
  restart();
  std::stop_source stop;
  worker_->give_up_with(stop.get_token());
  run_machine(6.5);
  std::vector<AxisStatus> seen;
  {
    const std::jthread working([&] { worker_->look(0); });
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (std::chrono::steady_clock::now() < until &&
           (seen.empty() || seen.at(1).activity == "waiting for motion"))
      worker_->update(seen);
    stop.request_stop();
  }
  EXPECT_THAT(seen.at(0).activity,
              MatchesRegex("identifying loop and friction .*; [0-9]+ s so far"));
  EXPECT_THAT(seen.at(1).activity,
              MatchesRegex("waiting for motion; on hold while X is identified, [0-9]+ s so far"));
  worker_->update(seen);
  EXPECT_EQ(seen.at(1).activity, "waiting for motion") << "nothing is being identified now";
}

TEST_F(WorkerTest, AModelComesIntoForceOnMotionThatItHasNotSeen) {
  restart();
  run_machine(6.5);
  ASSERT_TRUE(worker_->look(0));
  EXPECT_TRUE(announced_.empty()) << "a candidate is not published because it is new";
  EXPECT_EQ(in_force_[0].fresh(), nullptr);
  EXPECT_FALSE(worker_->look(0)) << "there is too little held-out motion yet";
  EXPECT_THAT(status().activity, HasSubstr("judging a candidate: 0.5 of 3.0 s of motion"));

  run_machine(3.5);
  ASSERT_TRUE(worker_->look(0));
  ASSERT_EQ(announced_.size(), 1U) << said_.str();
  const ModelRecord& record = announced_[0].record;
  EXPECT_EQ(record.version, 1);
  // The record's resolution of 0.1 um alone leaves 0.03 um RMS; the command's peak error is 1 mm.
  EXPECT_LT(record.holdout.rms, 0.15e-6);
  const TwinInForce* twin = in_force_[0].fresh();
  ASSERT_NE(twin, nullptr);
  EXPECT_EQ(twin->version, 1);
  EXPECT_EQ(twin->standard_deviation, record.holdout.rms);
  EXPECT_TRUE(twin->twin.loaded());
  EXPECT_EQ(newest_event().kind, "model_promoted");
  EXPECT_THAT(newest_event().text, HasSubstr("model 1 is in force: residual "));
  EXPECT_THAT(newest_event().text, HasSubstr("without a model "));
  EXPECT_THAT(said_.str(), HasSubstr("servotwind: X: model 1 is in force"));
  EXPECT_EQ(status().model_version, 1);
}

// The friction of the machine is a saturated sign: a model with too little of it is the one in
// force, one with the right friction is proposed, and then the first one again.
TEST_F(WorkerTest, AProposedModelIsJudgedLikeAnyOther) {
  restart();
  promote_one();
  const ModelRecord right = announced_[0].record;
  ModelRecord wrong = right;
  for (Effect& effect : wrong.model.effects) {
    for (double& coefficient : effect.coefficient) coefficient *= 0.8;
  }
  worker_->propose(0, wrong, "with less friction, as the test has it", 0.0, 6.0);
  EXPECT_FALSE(worker_->look(0)) << "it is judged on motion after now";
  EXPECT_THAT(newest_event().text, HasSubstr("a model with less friction, as the test has it"));
  EXPECT_EQ(newest_event().kind, "model_proposed");
  run_machine(3.5);
  ASSERT_TRUE(worker_->look(0));
  ASSERT_EQ(announced_.size(), 1U) << said_.str();
  EXPECT_THAT(status().last_refusal, HasSubstr("with less friction"));

  restart();
  ModelRecord stored = wrong;
  store_->promote(stored, event_now("model_promoted", "X", "by the test"), {});
  worker_->restore();
  ASSERT_EQ(announced_.size(), 2U);
  run_machine(1.0);
  worker_->propose(0, right, "with friction", 0.0, 6.0);
  worker_->look(0);
  run_machine(3.5);
  ASSERT_TRUE(worker_->look(0));
  ASSERT_EQ(announced_.size(), 3U) << said_.str();
  EXPECT_THAT(announced_[2].reason, HasSubstr("; with friction"));
  EXPECT_EQ(announced_[2].record.version, announced_[1].record.version + 1);
  EXPECT_LT(announced_[2].record.holdout.rms, 0.15e-6);
}

// Where the axis stands in a rest, and what of it friction holds, only the motion before tells.
TEST_F(WorkerTest, AModelThatIsProposedInARestIsJudgedWithTheMotionBefore) {
  const HeldAxis held = axis_held_by_friction();
  const Segment& all = held.segment();
  IdentifyOptions options;
  options.method = Method::kJoint;
  options.order = 2;
  const ModelRecord right = identify(held.axis, options).record;
  config_.judge_s = 1.5;
  restart();
  const auto run_until = [&](double end_s) {
    for (; static_cast<double>(row_) * all.sample_time_s < end_s; ++row_) {
      CycleRow row;
      row.time_ns = row_ * 1'000'000;
      row.after_gap = row_ == 0;
      row.axis_count = 1;
      row.axes[0] = {all.command(row_), all.actual(row_), kAbsent};
      memory_->append(row);
    }
  };
  run_until(held.in_rest_s);
  ASSERT_GT(std::abs(all.command(row_) - all.actual(row_)), 5e-6) << "held away";
  worker_->propose(0, right, "as the test has it", 0.0, 5.0);
  worker_->look(0);
  run_until(all.end_s());
  ASSERT_TRUE(worker_->look(0));
  ASSERT_EQ(announced_.size(), 1U) << status().last_refusal;
  EXPECT_LT(announced_[0].record.holdout.rms, 2.0 * right.training.rms);
}

TEST_F(WorkerTest, AProposedModelThatIsInvalidIsRefusedAtOnce) {
  restart();
  promote_one();
  ModelRecord wrong = announced_[0].record;
  wrong.model.loop.denominator[0] = -1.0;
  worker_->propose(0, wrong, "that is unstable", 0.0, 6.0);
  worker_->look(0);
  EXPECT_EQ(announced_.size(), 1U);
  EXPECT_THAT(status().last_refusal, HasSubstr("that is unstable"));
}

/// A model with four fifths of the friction of this one, as a person may propose it.
ModelProposal with_less_friction(ModelRecord record) {
  for (Effect& effect : record.model.effects) {
    for (double& coefficient : effect.coefficient) coefficient *= 0.8;
  }
  return {"X", "worse.json", false, to_json(record).dump()};
}

TEST_F(WorkerTest, AModelByHandIsJudgedUnlessItIsForced) {
  restart();
  promote_one();
  ModelProposal worse = with_less_friction(announced_[0].record);
  worker_->propose(worse);
  EXPECT_FALSE(worker_->look(0)) << "it is judged on motion after now";
  run_machine(3.5);
  ASSERT_TRUE(worker_->look(0));
  ASSERT_EQ(announced_.size(), 1U) << said_.str();
  EXPECT_THAT(status().last_refusal, AllOf(HasSubstr("must be better by"),
                                           HasSubstr("from worse.json, proposed by hand")));

  config_.window_s = 100.0;  // so that the worker makes no candidate of its own
  worker_->reconfigure(config_);
  worse.force = true;
  worker_->propose(worse);
  worker_->look(0);
  ASSERT_EQ(announced_.size(), 2U) << said_.str();
  EXPECT_THAT(store_->in_force().at(0).reason,
              HasSubstr("put in force without being judged (--force); from worse.json, proposed by "
                        "hand"))
      << "the store keeps how it came into force";
  EXPECT_EQ(status().model_version, 2);
  EXPECT_TRUE(std::isnan(announced_[1].record.holdout.rms)) << "nothing is known of its error";
  EXPECT_EQ(announced_[1].record.created, "") << "nothing is sent to drives by it";

  const ModelProposal better{"X", "better.json", false, to_json(announced_[0].record).dump()};
  run_machine(0.5);
  worker_->propose(better);
  worker_->look(0);
  run_machine(3.5);
  ASSERT_TRUE(worker_->look(0));
  ASSERT_EQ(announced_.size(), 3U) << said_.str();
  EXPECT_THAT(announced_[2].reason, HasSubstr("from better.json, proposed by hand"));
  EXPECT_GT(announced_[2].record.created, "2026") << "it was validated now";
}

TEST_F(WorkerTest, AModelByHandWaitsItsTurnAndNoDiagnosisTakesIt) {
  restart();
  promote_one();
  const ModelRecord record = announced_[0].record;
  worker_->propose(with_less_friction(record));
  worker_->look(0);
  ModelProposal second = with_less_friction(record);
  second.origin = "second.json";
  worker_->propose(second);
  worker_->propose(0, record, "of a diagnosis", 0.0, 6.0);
  run_machine(3.5);
  ASSERT_TRUE(worker_->look(0));
  worker_->look(0);
  EXPECT_THAT(newest_event().text, HasSubstr("from second.json"));
}

TEST_F(WorkerTest, AModelByHandThatCannotBeUsedIsRefusedWithTheReason) {
  restart();
  promote_one();
  const ModelProposal good = with_less_friction(announced_[0].record);
  const auto refusal = [&](const ModelProposal& proposal) {
    worker_->propose(proposal);
    return newest_event().text;
  };
  ModelProposal bad = good;
  bad.model_json = "{\"schema\":";
  EXPECT_THAT(refusal(bad), AllOf(HasSubstr("parse error"), HasSubstr("from worse.json")));
  bad.model_json.assign(2'000'000, ' ');
  EXPECT_THAT(refusal(bad), HasSubstr("larger than any model file"));
  bad = good;
  bad.axis = "Z";
  EXPECT_THAT(refusal(bad), HasSubstr("the machine has no such axis"));
  ModelRecord slow = announced_[0].record;
  slow.model.sample_time_s = 0.004;
  bad = good;
  bad.model_json = to_json(slow).dump();
  bad.force = true;
  EXPECT_THAT(refusal(bad), HasSubstr("is for a cycle of 0.004 s, the machine runs at 0.001 s"));
  ModelRecord timed = announced_[0].record;
  timed.model.effects.push_back(make_effect<AddedFriction>());
  timed.effect_deviations.resize(timed.model.effects.size());
  bad = good;
  bad.model_json = to_json(timed).dump();
  EXPECT_THAT(refusal(bad), HasSubstr("contains added_friction, which is of its recording"));
  bad = good;
  bad.origin = "Achse\xfc\nX";
  bad.model_json = "{}";
  EXPECT_THAT(refusal(bad), HasSubstr("from Achse??X, proposed by hand"));
  worker_->look(0);
  EXPECT_EQ(announced_.size(), 1U);
}

TEST_F(WorkerTest, AModelOfWorseDataIsRefusedWithTheFigures) {
  restart();
  promote_one();
  run_machine(1.99, 20e-6);  // an encoder that has become noisy for a while
  run_machine(0.01);
  ASSERT_TRUE(worker_->look(0));
  run_machine(3.5);
  ASSERT_TRUE(worker_->look(0));
  EXPECT_EQ(announced_.size(), 1U);
  EXPECT_EQ(newest_event().kind, "model_refused");
  EXPECT_THAT(newest_event().text, HasSubstr("candidate refused: "));
  EXPECT_THAT(newest_event().detail, HasSubstr("servotwin.model/1")) << "it can be looked at later";
  EXPECT_NE(store_->in_force()[0].validated, "") << "and the model in force was found to hold";
}

TEST_F(WorkerTest, AModelThatLeavesMoreThanTwiceIsNotFoundToHoldEvenIfNothingIsBetter) {
  restart();
  promote_one();
  run_machine(2.0, 20e-6);
  ASSERT_TRUE(worker_->look(0));
  run_machine(3.5, 20e-6);
  ASSERT_TRUE(worker_->look(0));
  EXPECT_EQ(announced_.size(), 1U);
  EXPECT_THAT(newest_event().text, HasSubstr("candidate refused: residual 19.6 um"));
  EXPECT_EQ(store_->in_force()[0].validated, "");
}

TEST_F(WorkerTest, AWorkerThatLagsDecidesTheSame) {
  restart();
  std::vector<std::string> in_time;
  for (int i = 0; i < 40; ++i) {
    run_machine(0.5);
    while (worker_->look(0)) {
    }
  }
  for (const Event& event : store_->events(100)) in_time.push_back(event.text);
  ASSERT_GE(in_time.size(), 2U) << said_.str();

  std::filesystem::remove(directory_.path() / "servotwin.sqlite");
  std::filesystem::remove_all(directory_.path() / "models");
  row_ = 0;
  restart();
  run_machine(20.0);
  worker_->finish();
  std::vector<std::string> later;
  for (const Event& event : store_->events(100)) {
    if (event.text.find("not decided") == event.text.npos) later.push_back(event.text);
  }
  EXPECT_EQ(later, in_time);
}

TEST_F(WorkerTest, AWorkerThatLagsBeyondTheMemorySaysSoOnceAndGoesOnWithWhatThereIs) {
  remembered_s_ = 8.0;
  restart();
  run_machine(25.0);
  ASSERT_TRUE(worker_->look(0));
  EXPECT_EQ(newest_event().kind, "motion_skipped");
  EXPECT_THAT(newest_event().text, HasSubstr("19.0 s of motion were skipped"));
  ASSERT_TRUE(worker_->look(0));
  EXPECT_EQ(newest_event().kind, "identification_step");
  run_machine(3.5);
  ASSERT_TRUE(worker_->look(0));
  EXPECT_EQ(announced_.size(), 1U) << said_.str();
}

TEST_F(WorkerTest, TheModelIsInForceAgainAfterARestart) {
  restart();
  promote_one();
  const double rms = announced_[0].record.holdout.rms;
  announced_.clear();
  (void)in_force_[0].fresh();
  restart();
  worker_->restore();
  ASSERT_EQ(announced_.size(), 1U);
  EXPECT_EQ(announced_[0].record.version, 1);
  const TwinInForce* twin = in_force_[0].fresh();
  ASSERT_NE(twin, nullptr);
  EXPECT_EQ(twin->standard_deviation, rms);
  EXPECT_THAT(said_.str(), HasSubstr("X: model 1 is in force again"));
}

TEST_F(WorkerTest, AModelOfAnotherAxisOrCycleIsLeftInTheStoreAndSaid) {
  restart();
  promote_one();
  machine_ = one_axis("Z");
  announced_.clear();
  restart();
  worker_->restore();
  EXPECT_TRUE(announced_.empty());
  EXPECT_THAT(said_.str(),
              HasSubstr("X: model 1 is in the store, but the machine has no such axis"));
  machine_ = {kCycle_s, {{"X", true, ""}}};
  restart();
  worker_->restore();
  EXPECT_TRUE(announced_.empty());
  EXPECT_THAT(said_.str(), HasSubstr("X: model 1 is for a linear axis, this one is rotary"));
  machine_ = {0.002, {{"X", false, ""}}};
  restart();
  worker_->restore();
  EXPECT_TRUE(announced_.empty());
  EXPECT_THAT(said_.str(),
              HasSubstr("X: model 1 is for a cycle of 0.001 s, the machine runs at 0.002 s"));
}

TEST_F(WorkerTest, OnAFullDiskTheOldModelStaysInForceAndItIsSaid) {
  restart();
  run_machine(6.5);
  ASSERT_TRUE(worker_->look(0));
  run_machine(3.5);
  {
    const FullDisk full;
    ASSERT_TRUE(worker_->look(0));
  }
  EXPECT_TRUE(announced_.empty()) << "what is not on the disk is not in force";
  EXPECT_EQ(in_force_[0].fresh(), nullptr);
  EXPECT_THAT(said_.str(), HasSubstr("is not in force, because it cannot be stored: store "));
  EXPECT_THAT(said_.str(), HasSubstr("this event could not be stored"));
  EXPECT_THAT(last_error(), HasSubstr("full"));
  EXPECT_TRUE(store_->in_force().empty());

  run_machine(3.5);
  ASSERT_TRUE(worker_->look(0));
  run_machine(3.5);
  ASSERT_TRUE(worker_->look(0));
  EXPECT_EQ(announced_.size(), 1U) << "the next candidate is stored again\n" << said_.str();
}

TEST_F(WorkerTest, WhatCannotBeIdentifiedIsSaidAndTriedAgainWithNewMotion) {
  restart();
  // A command, and an encoder that stands.
  for (int i = 0; i < 8000; ++i) {
    CycleRow row;
    row.time_ns = row_++ * 1'000'000;
    row.after_gap = i == 0;
    row.axis_count = 1;
    row.axes[0] = {command_at(i * kCycle_s), 0.0, kAbsent};
    memory_->append(row);
  }
  ASSERT_TRUE(worker_->look(0));
  EXPECT_EQ(newest_event().kind, "model_refused");
  EXPECT_THAT(newest_event().text, HasSubstr("no model was found: "));
  EXPECT_FALSE(worker_->look(0)) << "not again on the same data";
}

TEST_F(WorkerTest, MotionThatDoesNotExciteBringsNoModelIntoForce) {
  restart();
  // Forwards only, at changing speed: it can be followed well and still shows no friction.
  for (int i = 0; i < 12000; ++i) {
    const double t = i * kCycle_s;
    const auto command = [](double at) { return 0.05 * at + 0.004 * std::sin(4.0 * at); };
    CycleRow row;
    row.time_ns = row_++ * 1'000'000;
    row.after_gap = i == 0;
    row.axis_count = 1;
    row.axes[0] = {command(t), command(t - 0.008) + 1e-7 * std::normal_distribution<>()(random_),
                   kAbsent};
    memory_->append(row);
  }
  ASSERT_TRUE(worker_->look(0));
  EXPECT_EQ(newest_event().kind, "model_refused");
  EXPECT_THAT(newest_event().text, HasSubstr("friction is not excited"));
  EXPECT_TRUE(announced_.empty());
}

TEST_F(WorkerTest, AtTheEndAnUndecidedCandidateIsSaid) {
  restart();
  run_machine(6.5);
  ASSERT_TRUE(worker_->look(0));
  run_machine(1.0);
  worker_->finish();
  EXPECT_THAT(newest_event().text,
              HasSubstr("candidate not decided: it was judged on 1.5 of 3.0 s of motion"));
}

// On a busy host the diagnosis of a whole recording was done before the first identification: its
// proposal waited for motion that did not come, and the axis ended without a model.
TEST_F(WorkerTest, AtTheEndAnAxisWithoutAModelIsIdentifiedWhateverIsProposed) {
  restart();
  promote_one();
  const ModelRecord proposed = announced_[0].record;
  worker_.reset();
  events_.reset();
  store_.reset();
  std::filesystem::remove(directory_.path() / "servotwin.sqlite");
  std::filesystem::remove_all(directory_.path() / "models");
  announced_.clear();
  row_ = 0;
  restart();
  run_machine(10.0);
  worker_->propose(0, proposed, "as the diagnosis found", 0.0, 10.0);
  worker_->finish();
  EXPECT_THAT(said_.str(),
              HasSubstr("it was judged on 0.0 of 3.0 s of motion; as the diagnosis found"));
  ASSERT_EQ(announced_.size(), 1U) << said_.str();
  EXPECT_THAT(announced_[0].reason, Not(HasSubstr("as the diagnosis found")));
}

TEST_F(WorkerTest, AtTheEndAnAxisWithAModelIsNotIdentifiedOnceMore) {
  restart();
  promote_one();
  run_machine(8.0);  // enough for a step
  worker_->propose(0, announced_[0].record, "as the diagnosis found", 0.0, 10.0);
  const std::size_t steps = store_->events(100).size();
  worker_->finish();
  const std::vector<Event> events = store_->events(100);
  ASSERT_EQ(events.size(), steps + 2) << said_.str();  // proposed, not decided
  EXPECT_EQ(events[0].kind, "model_refused");
  EXPECT_EQ(events[1].kind, "model_proposed");
}

TEST_F(WorkerTest, WithoutAModelThatCanBeUsedItBeginsAnew) {
  restart();
  promote_one();
  worker_.reset();
  events_.reset();
  store_.reset();
  spoil(directory_.path(), other_models("'{'", ""));
  restart();
  EXPECT_THAT(store_->lost(), HasSubstr("the axis is identified again"));
  ASSERT_NE(in_force_[0].fresh(), nullptr) << "of before";
  const std::size_t announced = announced_.size();
  worker_->restore();
  EXPECT_EQ(announced_.size(), announced);
  EXPECT_NE(newest_event().kind, "model_restored");
}

}  // namespace
}  // namespace servotwin::daemon
