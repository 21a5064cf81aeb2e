#include "daemon/correct/learning_worker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "daemon/between/clock.h"
#include "tests/daemon/stepped_machine.h"
#include "twin/program_error.h"

namespace servotwin::daemon {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

MachineDescription two_axes() { return {kCycle_s, {{"X", false, ""}, {"Y", false, ""}}}; }

class LearningWorkerTest : public testing::Test {
 protected:
  void start() {
    worker_.reset();
    Config config;
    for (const char* name : {"X", "Y"}) {
      config.axes.push_back({name, false, ""});
      config.axes.back().correction = limits_;
    }
    config.ilc.programs = programs_;
    config.ilc.recognise = recognise_;
    worker_ = std::make_unique<LearningWorker>(
        learning_rules(config, two_axes()), store_, events_, hand_over_,
        [this](const CorrectionChunk& chunk) { announced_.push_back(chunk); });
  }
  void put_in_force(const Model& model, const std::string& axis, std::int64_t ago_ns = 0,
                    const MotionRange& motion = {}) {
    ModelRecord record = record_of(model, axis);
    record.motion = motion;
    record.created = iso_time(wall_ns() - ago_ns);
    store_.promote(record, {record.created, axis, "model_promoted", "made for this test", ""});
  }
  /// Sends a program of X and Y, or of X alone, in chunks.
  void send(const std::vector<Eigen::ArrayXd>& path, bool learn, const std::string& name = "part",
            std::uint64_t revision = 1) {
    const Eigen::Index rows = path.front().size(), most = 1000;
    ProgramChunk chunk;
    chunk.program = name;
    chunk.revision = revision;
    chunk.chunks = static_cast<std::uint32_t>((rows + most - 1) / most);
    chunk.learn = learn;
    for (std::size_t i = 0; i < path.size(); ++i) chunk.axes.push_back(i == 0 ? "X" : "Y");
    for (Eigen::Index from = 0; from < rows; from += most, ++chunk.chunk) {
      chunk.time_s.clear();
      chunk.command.clear();
      const Eigen::Index count = std::min(most, rows - from);
      for (Eigen::Index k = from; k < from + count; ++k)
        chunk.time_s.push_back(kCycle_s * static_cast<double>(k));
      for (const Eigen::ArrayXd& axis : path) {
        for (Eigen::Index k = from; k < from + count; ++k) chunk.command.push_back(axis(k));
      }
      worker_->take(chunk, 1);
    }
  }
  [[nodiscard]] std::vector<Event> events(const std::string& kind) const {
    std::vector<Event> out;
    for (const Event& event : store_.events(1000)) {
      if (event.kind == kind) out.push_back(event);
    }
    return out;
  }
  /// One axis of what was announced, whole.
  [[nodiscard]] Eigen::ArrayXd whole(const std::vector<double> CorrectionChunk::*what,
                                     std::size_t axis) const {
    std::vector<double> out;
    for (const CorrectionChunk& chunk : announced_) {
      const std::vector<double>& values = chunk.*what;
      const std::size_t rows = values.size() / chunk.axes.size();
      for (std::size_t k = 0; k < rows; ++k) out.push_back(values[axis * rows + k]);
    }
    return Eigen::Map<Eigen::ArrayXd>(out.data(), static_cast<Eigen::Index>(out.size()));
  }

  TemporaryDirectory directory_;
  Store store_{directory_.path(), "mill"};
  std::ostringstream said_;
  EventLog events_{store_, said_};
  std::optional<OffsetLimits> limits_ = OffsetLimits{3e-3, 0.2, 200.0};
  std::filesystem::path programs_;
  IlcConfig::Recognise recognise_ = IlcConfig::Recognise::kOffer;
  OffsetHandOver hand_over_;
  std::vector<CorrectionChunk> announced_;
  std::unique_ptr<LearningWorker> worker_;
};

// At constant velocity the lag is (a1 v + friction) / a2, independent of the simulation.
TEST_F(LearningWorkerTest, APreviewPredictsTheLagOfTheLoopInClosedForm) {
  put_in_force(drive(20.0, 0.3), "X");
  start();
  Eigen::ArrayXd ramp = Eigen::ArrayXd::Zero(2500);
  const double v = 0.05;
  for (Eigen::Index k = 500; k < ramp.size(); ++k)
    ramp(k) = v * kCycle_s * static_cast<double>(k - 500);
  send({ramp}, false);
  ASSERT_EQ(announced_.size(), 3U);
  for (std::uint32_t i = 0; i < 3; ++i) {
    EXPECT_EQ(announced_[i].chunk, i);
    EXPECT_EQ(announced_[i].chunks, 3U);
    EXPECT_EQ(announced_[i].state, CorrectionState::kPreviewed);
  }
  const double a2 = std::pow(2.0 * std::numbers::pi * 20.0, 2), a1 = 2.0 * 0.6 * std::sqrt(a2);
  const Eigen::ArrayXd error = whole(&CorrectionChunk::error_before, 0);
  ASSERT_EQ(error.size(), 2500);
  EXPECT_NEAR(error(2400), (a1 * v + 0.3) / a2, 1e-8);
  EXPECT_NEAR(announced_[0].axes[0].before_max, error.abs().maxCoeff(), 0.0);
  EXPECT_TRUE((whole(&CorrectionChunk::corrected, 0) == ramp).all()) << "nothing was learned";
  EXPECT_TRUE(std::isnan(announced_[0].contour_before_rms)) << "one axis draws no path";
  EXPECT_THAT(worker_->kept(), IsEmpty());
  EXPECT_EQ(events("program_previewed").size(), 1U);
}

TEST_F(LearningWorkerTest, AnAxisOfTwoMassesLearns) {
  Model two = drive(20.0, 0.3);
  Effect spring = make_effect<TwoMassOutside>();
  spring.shape = {60.0, 0.05, 0.4, 1.0};
  two.effects.push_back(spring);
  put_in_force(two, "X");
  start();
  send({circle_program()[0]}, true);
  ASSERT_FALSE(announced_.empty()) << said_.str();
  EXPECT_EQ(announced_[0].state, CorrectionState::kLearned) << announced_[0].reason;
  EXPECT_LT(announced_[0].axes[0].after_rms, 0.05 * announced_[0].axes[0].before_rms);
}

// Models are validated again as long as the machine works, so their corrections stay usable.
TEST_F(LearningWorkerTest, ACorrectionIsAsFreshAsTheOldestValidationOfItsModels) {
  const std::int64_t now = wall_ns(), hour = 3'600'000'000'000;
  put_in_force(model_of(stepped_axis()), "X", 4 * hour);
  put_in_force(model_of(stepped_axis()), "Y", 4 * hour);
  start();
  send({circle_program()[0], circle_program()[1]}, true);
  ASSERT_EQ(worker_->kept().size(), 1U) << said_.str();
  const auto fresh_for_h = [&] {
    return static_cast<double>(worker_->kept()[0]->validated_ns - now) / static_cast<double>(hour);
  };
  const auto take = [&] {
    const OffsetPlan* const* fresh = hand_over_.plans.fresh();
    if (fresh != nullptr) hand_over_.in_use = (*fresh)->generation;
    return fresh == nullptr ? nullptr : *fresh;
  };
  EXPECT_NEAR(fresh_for_h(), -4.0, 0.1);
  const OffsetPlan* const first = take();
  ASSERT_NE(first, nullptr);
  EXPECT_FALSE(first->renewed);

  store_.validate("X", 1, iso_time(now - 2 * hour));
  worker_->renew(LearningWorker::kRenewEvery_ns);
  EXPECT_NEAR(fresh_for_h(), -4.0, 0.1) << "Y was not";
  take();
  store_.validate("Y", 1, iso_time(now - 3 * hour));
  worker_->renew(LearningWorker::kRenewEvery_ns + 1);
  EXPECT_NEAR(fresh_for_h(), -4.0, 0.1) << "not looked after all the time";
  worker_->renew(2 * LearningWorker::kRenewEvery_ns);
  EXPECT_NEAR(fresh_for_h(), -3.0, 1e-6);
  const OffsetPlan* const renewed = take();
  ASSERT_NE(renewed, nullptr);
  EXPECT_TRUE(renewed->renewed) << "what was given up stays so";
  EXPECT_EQ(renewed->programs[0], worker_->kept()[0]);

  // The clock was a day ahead when the models were validated.
  for (const char* axis : {"X", "Y"}) store_.validate(axis, 1, iso_time(now + 24 * hour));
  worker_->renew(3 * LearningWorker::kRenewEvery_ns);
  EXPECT_NEAR(fresh_for_h(), 0.0, 0.1) << "nothing is validated in the future";

  put_in_force(model_of(stepped_axis()), "X");
  store_.validate("X", 2, iso_time(now + 48 * hour));
  store_.validate("Y", 1, iso_time(now + 48 * hour));
  const auto before = worker_->kept()[0];
  worker_->renew(4 * LearningWorker::kRenewEvery_ns);
  EXPECT_EQ(worker_->kept()[0], before) << "it was learned on another version of X";
}

// The corrected path, run on a machine that shares no code with the twin.
TEST_F(LearningWorkerTest, ACorrectedPathIsFollowedByTheMachineAsWasPredicted) {
  put_in_force(model_of(stepped_axis()), "X");
  put_in_force(model_of(stepped_axis()), "Y");
  start();
  const auto path = circle_program();
  send({path[0], path[1]}, true);
  ASSERT_GE(announced_.size(), 2U);
  const CorrectionChunk& head = announced_.front();
  ASSERT_EQ(head.state, CorrectionState::kLearned) << head.reason;
  ASSERT_EQ(head.axes.size(), 2U);
  EXPECT_EQ(head.axes[1].name, "Y");
  EXPECT_EQ(head.axes[1].model_version, 1);
  EXPECT_EQ(head.cycle_s, kCycle_s);
  EXPECT_NEAR(static_cast<double>(head.valid_until_ns - wall_ns()) * 1e-9, 604800.0, 60.0);

  std::vector<Eigen::ArrayXd> plain, corrected;
  for (std::size_t i = 0; i < 2; ++i) {
    const Eigen::ArrayXd command = whole(&CorrectionChunk::corrected, i);
    ASSERT_EQ(command.size(), path[i].size());
    EXPECT_EQ(command(0), path[i](0));
    EXPECT_EQ(command(command.size() - 1), path[i](command.size() - 1));
    SteppedAxis before(stepped_axis()), after(stepped_axis());
    plain.emplace_back(command.size());
    corrected.emplace_back(command.size());
    for (Eigen::Index k = 0; k < command.size(); ++k) {
      plain[i](k) = before.cycle(path[i](k));
      corrected[i](k) = after.cycle(command(k));
    }
    const double rms_before = size_of(path[i] - plain[i]).rms;
    const double rms_after = size_of(path[i] - corrected[i]).rms;
    EXPECT_NEAR(head.axes[i].before_rms, rms_before, 0.02 * rms_before);
    EXPECT_LT(rms_after, rms_before / 20.0) << head.reason;
    EXPECT_LT(head.axes[i].after_rms, rms_before / 20.0);
  }
  const std::array command{path[0], path[1]};
  const double contour_before = size_of(program_error(command, plain).distance).rms;
  const double contour_after = size_of(program_error(command, corrected).distance).rms;
  EXPECT_NEAR(head.contour_before_rms, contour_before, 0.05 * contour_before);
  EXPECT_LT(contour_after, contour_before / 5.0);

  const std::vector<Event> told = events("correction_learned");
  ASSERT_EQ(told.size(), 1U);
  EXPECT_THAT(told[0].text, AllOf(HasSubstr("program 'part'"), HasSubstr("contour")));
  const nlohmann::json detail = nlohmann::json::parse(told[0].detail);
  EXPECT_EQ(detail["axes"][1]["model_version"], 1);
  EXPECT_EQ(detail["contour_after_rms_m"], head.contour_after_rms);
  ASSERT_EQ(worker_->kept().size(), 1U);
  EXPECT_EQ(worker_->kept()[0]->why_not_live, "");
}

TEST_F(LearningWorkerTest, WhatTheLimitsDoNotAllowIsLearnedWithinThem) {
  put_in_force(model_of(stepped_axis()), "X");
  limits_ = OffsetLimits{1e-4, 0.01, 100.0};
  start();
  send({circle_program()[0]}, true);
  ASSERT_FALSE(announced_.empty());
  ASSERT_EQ(announced_[0].state, CorrectionState::kLearned) << announced_[0].reason;
  const Eigen::ArrayXd offset = whole(&CorrectionChunk::corrected, 0) - circle_program()[0];
  EXPECT_LE(offset.abs().maxCoeff(), 1e-4 * (1.0 + 1e-9));
  const Eigen::ArrayXd step = offset.tail(offset.size() - 1) - offset.head(offset.size() - 1);
  EXPECT_LE(step.abs().maxCoeff(), 0.01 * kCycle_s * (1.0 + 1e-6));
}

// Corrected axis by axis, the path error would be larger than without a correction.
TEST_F(LearningWorkerTest, LimitsThatLeaveNoCorrectionAreNamed) {
  virtual_machine::Axis other = stepped_axis();
  other.drive.position_gain = 40.0;
  put_in_force(model_of(stepped_axis()), "X");
  put_in_force(model_of(other), "Y");
  limits_ = OffsetLimits{6e-5, 0.005, 100.0};
  start();
  send({circle_program()[0], circle_program()[1]}, true);
  EXPECT_EQ(announced_.back().state, CorrectionState::kRefused);
  EXPECT_THAT(announced_.back().reason,
              AllOf(HasSubstr("X at its peak of 60 um"), HasSubstr("ilc.aim = \"contour\"")));
}

TEST_F(LearningWorkerTest, WithoutLimitsItIsLearnedAndNotForDrives) {
  put_in_force(model_of(stepped_axis()), "X");
  limits_.reset();
  start();
  send({circle_program()[0]}, true);
  ASSERT_FALSE(announced_.empty());
  EXPECT_EQ(announced_[0].state, CorrectionState::kLearned);
  EXPECT_THAT(
      announced_[0].reason,
      HasSubstr("not sent to drives: axis X has no correction = { peak, rate, bandwidth }"));
}

TEST_F(LearningWorkerTest, WhatLearnWarnsOfIsSaidHereToo) {
  ModelRecord record = record_of(model_of(stepped_axis()), "X");
  record.holdout = {3e-6, 9e-6};
  store_.promote(record, {record.created, "X", "model_promoted", "made for this test", ""});
  start();
  const Eigen::ArrayXd path = circle_program()[0];
  send({path}, true);
  ASSERT_FALSE(announced_.empty());
  // The predicted error itself is far smaller.
  EXPECT_THAT(announced_[0].reason, HasSubstr("; expect at least X 3.0"));
  EXPECT_THAT(announced_[0].reason, Not(HasSubstr("dwell")));
  send({path.head(900)}, true, "cut");
  EXPECT_THAT(announced_.back().reason,
              AllOf(HasSubstr("X rests 0 s at the end of the path, less than 0.1 s"),
                    HasSubstr("add a dwell at the end")));
}

// Ten days are more than ilc.model_age_s, a week.
TEST_F(LearningWorkerTest, ACorrectionOfModelsThatAreTooOldSaysSoAndAgainWhenItIsArmed) {
  put_in_force(model_of(stepped_axis()), "X", 10 * 86'400'000'000'000);
  start();
  send({circle_program()[0]}, true);
  ASSERT_FALSE(announced_.empty());
  EXPECT_THAT(announced_[0].reason, HasSubstr("nothing is sent until they are validated again"));
  worker_->report_stale();
  EXPECT_TRUE(events("correction_stale").empty());
  hand_over_.armed = true;
  worker_->report_stale();
  worker_->report_stale();
  ASSERT_EQ(events("correction_stale").size(), 1U);
  EXPECT_THAT(events("correction_stale")[0].text, HasSubstr("program 'part': armed, but"));

  put_in_force(model_of(stepped_axis()), "X");
  send({circle_program()[0]}, true, "part", 2);
  EXPECT_THAT(announced_.back().reason, Not(HasSubstr("nothing is sent")));
}

// The circle is run at 0.1 m/s.
TEST_F(LearningWorkerTest, BeyondTheMotionOfTheModelItIsSaidAndFarBeyondRefused) {
  put_in_force(model_of(stepped_axis()), "X", 0, {0.04, 10.0});
  start();
  send({circle_program()[0]}, true);
  ASSERT_FALSE(announced_.empty());
  EXPECT_EQ(announced_[0].state, CorrectionState::kLearned);
  EXPECT_THAT(announced_[0].reason, HasSubstr("; X: the command reaches 2.5 times the speed"));

  put_in_force(model_of(stepped_axis()), "X", 0, {0.0001, 0.001});
  for (const bool learn : {true, false}) {
    announced_.clear();
    send({circle_program()[0]}, learn, "mm for m", learn ? 1 : 2);
    ASSERT_FALSE(announced_.empty());
    EXPECT_EQ(announced_[0].state, learn ? CorrectionState::kRefused : CorrectionState::kPreviewed);
    EXPECT_THAT(announced_[0].reason, HasSubstr("X: the command reaches 1000 times the speed"));
  }
}

// If both were kept, neither would be recognised: the matcher would wait until they differ.
TEST_F(LearningWorkerTest, TheSamePathUnderAnotherNameTakesThePlaceOfTheFirst) {
  put_in_force(model_of(stepped_axis()), "X");
  start();
  const Eigen::ArrayXd path = circle_program()[0];
  send({path}, true, "ca");
  send({path.tail(path.size() - 100)}, true, "cb");  // a tenth of a second less of dwell
  ASSERT_EQ(worker_->kept().size(), 1U);
  EXPECT_EQ(worker_->kept()[0]->program.name, "cb");
  EXPECT_EQ(announced_.back().program, "ca");
  EXPECT_EQ(announced_.back().state, CorrectionState::kWithdrawn);
  EXPECT_THAT(announced_.back().reason, HasSubstr("program 'cb' is the same path"));
  EXPECT_THAT(worker_->kept()[0]->notes, testing::Contains(HasSubstr("replaces program 'ca'")));

  send({0.999 * path}, true, "other");
  EXPECT_EQ(worker_->kept().size(), 2U);
}

TEST_F(LearningWorkerTest, AJumpOfTheCommandIsRefused) {
  put_in_force(model_of(stepped_axis()), "X");
  start();
  Eigen::ArrayXd path = circle_program()[0];
  path.tail(path.size() - 700) += 0.01;
  send({path}, true);
  EXPECT_EQ(announced_.back().state, CorrectionState::kRefused);
  EXPECT_THAT(announced_.back().reason,
              HasSubstr("X.command jumps by 10 mm within one cycle, into row 701 (at 0.7 s)"));
}

TEST_F(LearningWorkerTest, WhatCannotBeLearnedIsRefusedByName) {
  start();
  send({circle_program()[0]}, true);
  ASSERT_EQ(announced_.size(), 1U);
  EXPECT_EQ(announced_[0].state, CorrectionState::kRefused);
  EXPECT_EQ(announced_[0].program, "part");
  EXPECT_EQ(announced_[0].reason, "axis X has no model in force yet");
  EXPECT_TRUE(announced_[0].corrected.empty());
  std::string last_error;
  events_.update_last_error(last_error);
  EXPECT_THAT(last_error, HasSubstr("program 'part': axis X has no model in force yet"));

  Model other = model_of(stepped_axis());
  other.sample_time_s = 0.002;
  put_in_force(other, "X");
  send({circle_program()[0]}, true, "part", 2);
  EXPECT_THAT(announced_.back().reason, HasSubstr("its model is for a cycle of 0.002 s"));

  send({Eigen::ArrayXd::Constant(100, kAbsent)}, true, "wild", 1);
  EXPECT_EQ(announced_.back().program, "wild");
  EXPECT_THAT(announced_.back().reason, HasSubstr("not a number"));
}

TEST_F(LearningWorkerTest, ARefusedRevisionTakesBackTheOneBefore) {
  put_in_force(model_of(stepped_axis()), "X");
  start();
  send({circle_program()[0]}, true, "part", 1);
  ASSERT_EQ(worker_->kept().size(), 1U);
  send({Eigen::ArrayXd::Constant(100, kAbsent)}, true, "part", 2);
  EXPECT_THAT(worker_->kept(), IsEmpty());
}

TEST_F(LearningWorkerTest, AFileInTheFolderIsLearnedOnceItsAxesHaveModelsAndForAsLongAsItIsThere) {
  const TemporaryDirectory parts;
  programs_ = parts.path();
  put_in_force(model_of(stepped_axis()), "X");
  start();
  std::int64_t now = 0;
  const auto look = [&] {
    worker_->look_into_folder(now);
    now += LearningWorker::kLookEvery_ns;
  };
  {
    const auto path = circle_program();
    std::ofstream file(parts.path() / "ring.csv");
    file.precision(12);
    file << "time[s],X.command[mm],Y.command[mm]\n";
    for (Eigen::Index k = 0; k < path[0].size(); ++k)
      file << kCycle_s * static_cast<double>(k) << "," << 1e3 * path[0](k) << ","
           << 1e3 * path[1](k) << "\n";
  }
  look();
  worker_->look_into_folder(now - 1);  // too early
  EXPECT_THAT(events("program_refused"), IsEmpty());
  look();
  ASSERT_EQ(events("program_refused").size(), 1U);
  EXPECT_THAT(events("program_refused")[0].text, AllOf(HasSubstr("'ring'"), HasSubstr("Y")));
  look();
  EXPECT_EQ(events("program_refused").size(), 1U) << "nothing has changed";

  put_in_force(model_of(stepped_axis()), "Y");
  look();
  ASSERT_EQ(worker_->kept().size(), 1U);
  EXPECT_EQ(worker_->kept()[0]->program.name, "ring");
  const auto path = circle_program();
  EXPECT_LT((worker_->kept()[0]->program.command[0] - path[0]).abs().maxCoeff(), 1e-11);
  look();
  EXPECT_EQ(events("correction_learned").size(), 1U);

  send({path[0], path[1]}, true, "other", 5);
  std::filesystem::remove(parts.path() / "ring.csv");
  look();
  const std::vector<Event> withdrawn = events("correction_withdrawn");
  ASSERT_EQ(withdrawn.size(), 1U) << "the same path under another name has replaced it before";
  EXPECT_THAT(withdrawn[0].text, HasSubstr("'other' is the same path"));
  EXPECT_EQ(worker_->kept().size(), 1U);
}

/// A program of axis X alone [m].
void write_path(const std::filesystem::path& name, const Eigen::ArrayXd& command) {
  std::ofstream file(name);
  file.precision(12);
  file << "time[s],X.command[m]\n";
  for (Eigen::Index k = 0; k < command.size(); ++k)
    file << kCycle_s * static_cast<double>(k) << "," << command(k) << "\n";
}

TEST_F(LearningWorkerTest, WithItsFileACorrectionIsWithdrawnButNotOneFromTheNetwork) {
  const TemporaryDirectory parts;
  programs_ = parts.path();
  for (const char* axis : {"X", "Y"}) put_in_force(model_of(stepped_axis()), axis);
  start();
  const auto path = circle_program();
  write_path(parts.path() / "a.csv", path[0]);
  write_path(parts.path() / "b.csv", 0.5 * path[0]);
  worker_->look_into_folder(0);
  worker_->look_into_folder(LearningWorker::kLookEvery_ns);
  ASSERT_EQ(worker_->kept().size(), 2U);
  send({0.7 * path[0]}, true, "b", 7);  // from the network, in place of the file's
  ASSERT_EQ(worker_->kept().size(), 2U);
  for (const char* name : {"a.csv", "b.csv"}) std::filesystem::remove(parts.path() / name);
  worker_->look_into_folder(2 * LearningWorker::kLookEvery_ns);
  ASSERT_EQ(worker_->kept().size(), 1U);
  EXPECT_EQ(worker_->kept()[0]->program.name, "b");
  ASSERT_EQ(events("correction_withdrawn").size(), 1U);
  EXPECT_THAT(events("correction_withdrawn")[0].text,
              AllOf(HasSubstr("'a'"), HasSubstr(parts.path().string())));
  EXPECT_EQ(announced_.back().state, CorrectionState::kWithdrawn);
}

TEST_F(LearningWorkerTest, ASecondFileOfTheSameNameChangesNothingOfTheFirst) {
  const TemporaryDirectory parts;
  programs_ = parts.path();
  for (const char* axis : {"X", "Y"}) put_in_force(model_of(stepped_axis()), axis);
  start();
  const Eigen::ArrayXd path = circle_program()[0];
  std::int64_t now = 0;
  const auto look = [&] {
    worker_->look_into_folder(now);
    now += LearningWorker::kLookEvery_ns;
  };
  write_path(parts.path() / "part 1.csv", path);
  look();
  look();
  ASSERT_EQ(worker_->kept().size(), 1U);
  EXPECT_THAT(events("program_renamed")[0].text, HasSubstr("'part 1.csv' is program 'part_1'"));
  write_path(parts.path() / "part_1.csv", 0.5 * path);
  look();
  look();
  ASSERT_EQ(events("program_refused").size(), 1U);
  EXPECT_THAT(events("program_refused")[0].text, HasSubstr("rename one of them"));
  ASSERT_EQ(worker_->kept().size(), 1U);
  EXPECT_LT((worker_->kept()[0]->program.command[0] - path).abs().maxCoeff(), 1e-11);
  std::filesystem::remove(parts.path() / "part 1.csv");
  look();
  EXPECT_EQ(events("correction_withdrawn").size(), 1U) << "it is known which file it was of";
}

TEST_F(LearningWorkerTest, OfTwoFilesOfOnePathTheOtherIsLearnedWhenOneIsRemoved) {
  const TemporaryDirectory parts;
  programs_ = parts.path();
  for (const char* axis : {"X", "Y"}) put_in_force(model_of(stepped_axis()), axis);
  start();
  const Eigen::ArrayXd path = circle_program()[0];
  for (const char* name : {"first.csv", "second.csv"}) write_path(parts.path() / name, path);
  std::int64_t now = 0;
  const auto look = [&] {
    worker_->look_into_folder(now);
    now += LearningWorker::kLookEvery_ns;
  };
  look();
  look();
  ASSERT_EQ(worker_->kept().size(), 1U);
  EXPECT_THAT(events("correction_learned")[0].text, HasSubstr("Y not in the path: taken to stand"));
  const std::string kept = worker_->kept()[0]->program.name;
  std::filesystem::remove(parts.path() / (kept + ".csv"));
  look();
  look();
  ASSERT_EQ(worker_->kept().size(), 1U);
  EXPECT_EQ(worker_->kept()[0]->program.name, kept == "first" ? "second" : "first");
  const auto learned = events("correction_learned").size();
  look();
  EXPECT_EQ(events("correction_learned").size(), learned) << "nothing has changed";
}

/// A machine whose commands the worker hears: the circle of X and Y over and over, with pauses that
/// differ.
class RecognisingWorkerTest : public LearningWorkerTest {
 protected:
  void start() {
    LearningWorkerTest::start();
    worker_->show_in(inbox().list());
    worker_->hear_with([this](double after_s) { return heard(after_s); },
                       [this](const std::string& program) { return inbox().accept(program); });
  }
  ProgramInbox& inbox() {
    if (!inbox_) inbox_ = std::make_unique<ProgramInbox>(programs_, two_axes(), events_);
    return *inbox_;
  }
  void run_circle(int times) { run(circle_program(), times); }
  void run(const std::array<Eigen::ArrayXd, 2>& path, int times) {
    for (int i = 0; i < times; ++i) {
      for (Eigen::Index k = 0; k < path[0].size(); ++k) command({path[0](k), path[1](k)});
      for (int k = 0; k < 50 + 7 * i; ++k) command({path[0](0), path[1](0)});
    }
  }
  void command(const std::array<double, 2>& now) {
    machine_.time.push_back(machine_.time.empty() ? kCycle_s : machine_.time.back() + kCycle_s);
    for (std::size_t i = 0; i < 2; ++i) machine_.axes[i].command.push_back(now[i]);
  }
  Recording heard(double after_s) const {
    Recording out{"", {}, {{"X", false, {}, {}, {}, {}}, {"Y", false, {}, {}, {}, {}}}, {}};
    for (std::size_t k = 0; k < machine_.time.size(); ++k) {
      if (machine_.time[k] <= after_s) continue;
      out.time.push_back(machine_.time[k]);
      for (std::size_t i = 0; i < 2; ++i)
        out.axes[i].command.push_back(machine_.axes[i].command[k]);
    }
    return out;
  }
  void look() {
    worker_->look_for_repetition(now_ns_ += LearningWorker::kLookEvery_ns);
    worker_->look_into_folder(now_ns_);
    worker_->show();
  }
  std::map<std::string, ProgramState> listed() { return inbox().list().states(); }

  Recording machine_{"", {}, {{"X", false, {}, {}, {}, {}}, {"Y", false, {}, {}, {}, {}}}, {}};
  std::unique_ptr<ProgramInbox> inbox_;
  std::int64_t now_ns_ = 0;
};

TEST_F(RecognisingWorkerTest, WhatRepeatsIsOfferedOnceAndLearnedWhenItIsAccepted) {
  const TemporaryDirectory parts;
  programs_ = parts.path();
  for (const char* axis : {"X", "Y"}) put_in_force(model_of(stepped_axis()), axis);
  start();
  run_circle(2);
  look();
  EXPECT_THAT(listed(), IsEmpty());
  EXPECT_FALSE(inbox().list().repeats());
  for (int i = 0; i < 3; ++i) {
    run_circle(1);
    look();
  }
  ASSERT_EQ(listed().size(), 1U) << said_.str();
  const auto [name, state] = *listed().begin();
  EXPECT_EQ(state.what, ProgramState::What::kRecognised);
  EXPECT_THAT(state.text, HasSubstr("X, Y repeat"));
  ASSERT_EQ(events("motion_repeats").size(), 1U);
  EXPECT_THAT(events("motion_repeats")[0].text,
              AllOf(HasSubstr("'" + name + "'"), HasSubstr("3 times"),
                    HasSubstr("PUT /api/v1/programs/" + name)));
  ASSERT_TRUE(inbox().list().repeats());
  EXPECT_THAT(inbox().list().repeats()->programs, testing::ElementsAre(name));
  EXPECT_EQ(inbox().list().repeats()->repetitions, 5U);
  const double round_s = kCycle_s * static_cast<double>(circle_program()[0].size());
  EXPECT_NEAR(inbox().list().repeats()->shortest_period_s, round_s + 0.05, 1e-9);
  EXPECT_NEAR(inbox().list().repeats()->longest_period_s, round_s + 0.057, 1e-9);
  EXPECT_THAT(worker_->kept(), IsEmpty()) << "nothing is learned without a request";

  EXPECT_EQ(inbox().accept("nobody").what, ProgramInbox::Outcome::What::kRefused);
  EXPECT_EQ(inbox().accept(name).what, ProgramInbox::Outcome::What::kDone);
  look();
  look();
  ASSERT_EQ(worker_->kept().size(), 1U) << said_.str();
  EXPECT_EQ(worker_->kept()[0]->program.name, name);
  EXPECT_EQ(listed().begin()->second.what, ProgramState::What::kLearned);
  // The circle from its first motion on: an interior point of it, wherever it is cut.
  const CommandedPath& program = worker_->kept()[0]->program;
  const auto path = circle_program();
  EXPECT_TRUE(begin_alike(program, {"", 0, true, {0, 1}, {path[0], path[1]}}, 1e-12));

  run_circle(2);
  look();
  EXPECT_EQ(events("motion_repeats").size(), 1U);
  EXPECT_THAT(inbox().list().repeats()->programs, testing::ElementsAre(name));
}

TEST_F(RecognisingWorkerTest, WithLearnItIsPutIntoTheFolderAtOnceAndOnlyOnce) {
  const TemporaryDirectory parts;
  programs_ = parts.path();
  recognise_ = IlcConfig::Recognise::kLearn;
  for (const char* axis : {"X", "Y"}) put_in_force(model_of(stepped_axis()), axis);
  start();
  run_circle(3);
  for (int i = 0; i < 3; ++i) look();
  ASSERT_EQ(worker_->kept().size(), 1U) << said_.str();
  EXPECT_THAT(worker_->kept()[0]->program.name, testing::StartsWith("motion-"));

  start();  // after a restart the file is there
  machine_.time.clear();
  for (AxisRecord& axis : machine_.axes) axis.command.clear();
  look();
  look();
  ASSERT_EQ(worker_->kept().size(), 1U);
  run_circle(4);
  look();
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(parts.path()), {}), 1);
  EXPECT_EQ(events("program_received").size(), 1U);
  EXPECT_EQ(events("motion_repeats").size(), 1U) << "it is known";
}

TEST_F(RecognisingWorkerTest, AProgramThatIsKnownIsNotOfferedAndOneThatBecomesKnownNoLonger) {
  for (const char* axis : {"X", "Y"}) put_in_force(model_of(stepped_axis()), axis);
  start();
  const auto path = circle_program();
  send({path[0], path[1]}, true, "ring");
  run_circle(3);
  look();
  EXPECT_THAT(events("motion_repeats"), IsEmpty());
  ASSERT_TRUE(inbox().list().repeats());
  EXPECT_THAT(inbox().list().repeats()->programs, testing::ElementsAre("ring"));

  start();  // it is forgotten
  run_circle(1);
  look();
  ASSERT_EQ(events("motion_repeats").size(), 1U);
  EXPECT_THAT(events("motion_repeats")[0].text, HasSubstr("configure ilc.programs"));
  send({path[0], path[1]}, true, "ring");
  worker_->show();
  EXPECT_EQ(listed().size(), 1U);
  EXPECT_EQ(listed().begin()->first, "ring");
}

// The motion of X is that of a file which also has Y, where it stands.
TEST_F(RecognisingWorkerTest, AStandingAxisInTheFileMakesNoOtherMotionOfIt) {
  const TemporaryDirectory parts;
  programs_ = parts.path();
  recognise_ = IlcConfig::Recognise::kLearn;
  for (const char* axis : {"X", "Y"}) put_in_force(model_of(stepped_axis()), axis);
  start();
  const auto path = circle_program();
  const Eigen::ArrayXd standing = Eigen::ArrayXd::Constant(path[0].size(), path[1](0));
  send({path[0], standing}, true, "ring");
  run({path[0], standing}, 3);
  look();
  EXPECT_THAT(events("motion_repeats"), IsEmpty());
  ASSERT_TRUE(inbox().list().repeats());
  EXPECT_THAT(inbox().list().repeats()->programs, testing::ElementsAre("ring"));
  send({path[0]}, true, "alone");
  ASSERT_EQ(worker_->kept().size(), 1U) << "of the two neither would be recognised";
  EXPECT_EQ(worker_->kept()[0]->program.name, "alone");
}

// Eight corrections are kept at most. Two records of one motion, each within the tolerance of 2 um
// of it, may be up to twice as far from each other, and would get other names.
TEST_F(RecognisingWorkerTest, WithLearnMoreMotionsThanAreKeptHaveOneFileEach) {
  const TemporaryDirectory parts;
  programs_ = parts.path();
  recognise_ = IlcConfig::Recognise::kLearn;
  put_in_force(model_of(stepped_axis()), "X");
  constexpr int kMotions = 10;
  const Eigen::ArrayXd one = circle_program()[0];
  for (int round = 0; round < 2; ++round) {
    start();  // it forgets what it has recognised
    look();
    for (int i = 0; i < kMotions; ++i) {
      Eigen::ArrayXd path = (1.0 - 0.01 * i) * one;
      path.segment(1000, 100) += 3e-6 * round;
      run({path, Eigen::ArrayXd::Zero(path.size())}, 3);
      look();
      look();
      EXPECT_EQ(events("motion_repeats").size(), round == 0 ? i + 1U : kMotions) << said_.str();
    }
    EXPECT_EQ(worker_->kept().size(), LearningWorker::kMaxKept);
    machine_.time.clear();
    for (AxisRecord& axis : machine_.axes) axis.command.clear();
  }
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(parts.path()), {}), kMotions);
}

TEST_F(RecognisingWorkerTest, AFileOfItsNameWithAnotherPathIsLeftAlone) {
  const TemporaryDirectory parts;
  programs_ = parts.path();
  recognise_ = IlcConfig::Recognise::kLearn;
  start();
  run_circle(3);
  look();
  ASSERT_EQ(events("motion_repeats").size(), 1U);
  const std::filesystem::path file = std::filesystem::directory_iterator(parts.path())->path();
  std::ofstream(file) << "time[s],X.command[m]\n0,0\n";
  start();
  machine_.time.clear();
  for (AxisRecord& axis : machine_.axes) axis.command.clear();
  look();
  run_circle(3);
  look();
  EXPECT_TRUE(std::filesystem::exists(parts.path() / (file.stem().string() + "-2.csv")));
}

TEST_F(RecognisingWorkerTest, ARepetitionIsOverWhenNothingOfItComesForTwoPeriods) {
  for (const char* how : {"stands", "moves without a rest", "sends nothing", "has an offset"}) {
    SCOPED_TRACE(how);
    start();
    run_circle(3);
    look();
    ASSERT_TRUE(inbox().list().repeats());
    const double period_s = inbox().list().repeats()->longest_period_s;
    const auto go_on = [&](double seconds) {
      for (double t = 0.0; t < seconds; t += kCycle_s) {
        const double moved = how == std::string("stands") ? 0.0 : 1e-3 * std::sin(3.0 * t);
        if (how != std::string("sends nothing")) command({moved, 0.0});
      }
      now_ns_ += std::llround(1e9 * seconds) - LearningWorker::kLookEvery_ns;
      look();
    };
    if (how == std::string("has an offset")) {
      OffsetRun run;
      run.live = true;
      hand_over_.runs.push(run);
      worker_->judge_runs();
      worker_->show();
    } else {
      go_on(1.9 * period_s);
      EXPECT_TRUE(inbox().list().repeats());
      go_on(0.6 * period_s);
    }
    EXPECT_FALSE(inbox().list().repeats());
    machine_.time.clear();
    for (AxisRecord& axis : machine_.axes) axis.command.clear();
  }
}

TEST_F(RecognisingWorkerTest, CommandsWithAnOffsetAreNoProgram) {
  for (const char* axis : {"X", "Y"}) put_in_force(model_of(stepped_axis()), axis);
  // `busy`: the worker has learned another program meanwhile, and hears all runs at once.
  for (const bool live : {false, true}) {
    for (const bool busy : {false, true}) {
      SCOPED_TRACE(std::string(live ? "live" : "dry run") + (busy ? ", busy" : ""));
      start();
      send({0.5 * circle_program()[0]}, true, "other");
      for (int i = 0; i < 4; ++i) {
        run_circle(1);
        if (!busy) look();
        OffsetRun run;
        run.learned = worker_->kept()[0]->number;
        run.live = live;
        hand_over_.runs.push(run);
        if (!busy) worker_->judge_runs();
      }
      worker_->judge_runs();
      look();
      EXPECT_EQ(inbox().list().repeats().has_value(), !live);
      machine_.time.clear();
      for (AxisRecord& axis : machine_.axes) axis.command.clear();
    }
  }
}

TEST_F(RecognisingWorkerTest, NothingIsRecognisedWhereThatIsOff) {
  recognise_ = IlcConfig::Recognise::kOff;
  start();
  run_circle(4);
  look();
  EXPECT_THAT(listed(), IsEmpty());
  EXPECT_THAT(events("motion_repeats"), IsEmpty());
}

TEST_F(LearningWorkerTest, LearningIsGivenUpWhenTheDaemonStops) {
  put_in_force(model_of(stepped_axis()), "X");
  start();
  std::stop_source stop;
  stop.request_stop();
  worker_->give_up_with(stop.get_token());
  send({circle_program()[0]}, true);
  ASSERT_EQ(announced_.size(), 1U);
  EXPECT_THAT(announced_[0].reason, HasSubstr("aborted, because the daemon stops"));
}

TEST_F(LearningWorkerTest, TheNewestCorrectionsAreKept) {
  put_in_force(model_of(stepped_axis()), "X");
  start();
  for (std::size_t i = 0; i <= LearningWorker::kMaxKept; ++i)
    send({(1.0 - 0.01 * static_cast<double>(i)) * circle_program()[0].head(900)}, true,
         "part" + std::to_string(i));
  ASSERT_EQ(worker_->kept().size(), LearningWorker::kMaxKept);
  EXPECT_EQ(worker_->kept().front()->program.name, "part1");
  EXPECT_EQ(worker_->kept().back()->program.name, "part8");
}

}  // namespace
}  // namespace servotwin::daemon
