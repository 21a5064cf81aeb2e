#include "daemon/diagnose/diagnosis_worker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <random>
#include <sstream>

#include "drivers/recordings/table/csv.h"
#include "tests/daemon/full_disk.h"
#include "tests/daemon/support.h"
#include "tests/hidden_effects/cases.h"
#include "twin/twin.h"

namespace servotwin::daemon {
namespace {

using nlohmann::json;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class DiagnosisWorkerTest : public testing::Test {
 protected:
  DiagnosisWorkerTest() {
    config_.record_s = 20.0;
    config_.every_s = 100.0;
    config_.reference_s = 60.0;
  }

  /// A worker over a store that is opened anew, as after a restart.
  void restart(double remembered_s = 1000.0) {
    worker_.reset();
    watch_.reset();
    events_.reset();
    store_.reset();
    announced_.clear();
    memory_ = std::make_unique<MotionMemory>(machine_, remembered_s);
    store_ = std::make_unique<Store>(directory_.path(), "mill");
    events_ = std::make_unique<EventLog>(*store_, said_);
    watch_ = std::make_unique<ResidualWatch>(machine_, config_, *events_);
    worker_ = std::make_unique<DiagnosisWorker>(
        machine_, config_, IdentifyConfig(), *memory_, *watch_, *store_, *events_,
        [this](const StoredDiagnosis& made) { announced_.push_back(made); });
    worker_->propose_with([this](std::size_t, const ModelRecord& record, const std::string& with,
                                 double, double) { proposed_.emplace_back(record, with); });
  }
  void append(CycleRow row) {
    row.time_ns = rows_++ * std::llround(machine_.cycle_s * 1e9);
    row.after_gap = rows_ == 1;
    row.axis_count = static_cast<int>(machine_.axes.size());
    memory_->append(row);
    watch_->append(row);
  }
  /// A command with an encoder that stands still: its diagnosis fails at once. These tests check
  /// when it is tried.
  void run_machine(double seconds, double residual = 1e-6) {
    for (int i = 0; i < static_cast<int>(seconds / machine_.cycle_s); ++i) {
      CycleRow row;
      row.axes[0] = {command_at(static_cast<double>(rows_) * kCycle_s), 0.0, kAbsent};
      row.residuals[0] = {residual, 1e-6, 1};
      append(row);
    }
  }
  void stand(double seconds) {
    for (int i = 0; i < static_cast<int>(seconds / machine_.cycle_s); ++i) {
      CycleRow row;
      row.axes[0] = {0.01, 0.0, kAbsent};
      append(row);
    }
  }
  /// The events, the oldest first.
  [[nodiscard]] std::vector<std::string> events(const std::string& kind) const {
    std::vector<std::string> out;
    for (const Event& event : store_->events(1000)) {
      if (event.kind == kind) out.insert(out.begin(), event.text);
    }
    return out;
  }

  TemporaryDirectory directory_;
  MachineDescription machine_ = one_axis();
  DiagnoseConfig config_;
  std::ostringstream said_;
  std::unique_ptr<MotionMemory> memory_;
  std::unique_ptr<Store> store_;
  std::unique_ptr<EventLog> events_;
  std::unique_ptr<ResidualWatch> watch_;
  std::unique_ptr<DiagnosisWorker> worker_;
  std::vector<StoredDiagnosis> announced_;
  std::vector<std::pair<ModelRecord, std::string>> proposed_;
  std::int64_t rows_ = 0;
};

TEST_F(DiagnosisWorkerTest, TheFirstIsDueWhenThereIsMotionAndTheNextAfterItsTime) {
  restart();
  stand(200.0);
  EXPECT_FALSE(worker_->look(0));
  run_machine(19.0);
  EXPECT_FALSE(worker_->look(0));
  run_machine(1.5);
  EXPECT_TRUE(worker_->look(0));
  run_machine(95.0);
  EXPECT_FALSE(worker_->look(0));
  run_machine(6.0);
  EXPECT_TRUE(worker_->look(0));
  EXPECT_FALSE(worker_->look(0));
  EXPECT_THAT(events("diagnosis_begun"),
              ElementsAre("diagnosis begun, on schedule", "diagnosis begun, on schedule"));
  EXPECT_THAT(events("diagnosis_failed"),
              ElementsAre(HasSubstr("no diagnosis: "), HasSubstr("no diagnosis: ")));
  EXPECT_THAT(events("diagnosis_failed")[0], HasSubstr("X.actual"));
  EXPECT_THAT(announced_, IsEmpty());
}

TEST_F(DiagnosisWorkerTest, ADiagnosisThatIsGivenUpHasNotFailed) {
  restart();
  std::stop_source stop;
  stop.request_stop();
  worker_->give_up_with(stop.get_token());
  run_machine(20.5);
  EXPECT_TRUE(worker_->look(0));
  EXPECT_THAT(events("diagnosis_given_up"), SizeIs(1));
  EXPECT_THAT(events("diagnosis_failed"), IsEmpty());
}

TEST_F(DiagnosisWorkerTest, MotionThatIsHardlyRememberedIsNotDiagnosed) {
  restart(30.0);
  run_machine(19.0);
  stand(38.0);  // 30 s and the quarter that is forgotten at once
  run_machine(1.5);
  EXPECT_FALSE(worker_->look(0));
  run_machine(9.0);
  EXPECT_TRUE(worker_->look(0));
}

TEST_F(DiagnosisWorkerTest, OffIsOff) {
  config_.every_s = 0.0;
  restart();
  run_machine(300.0);
  EXPECT_FALSE(worker_->look(0));
  worker_->finish();
  EXPECT_THAT(events("diagnosis_begun"), IsEmpty());
}

TEST_F(DiagnosisWorkerTest, AnAlarmIsDiagnosedWithoutWaitingForTheSchedule) {
  config_.every_s = 0.0;
  restart();
  run_machine(65.0);
  EXPECT_FALSE(worker_->look(0));
  run_machine(20.0, 4e-6);
  EXPECT_THAT(events("alarm_raised"), SizeIs(1));
  EXPECT_TRUE(worker_->look(0));
  EXPECT_THAT(events("diagnosis_begun"),
              ElementsAre(AllOf(HasSubstr("diagnosis begun, the residual has grown: "),
                                HasSubstr("um RMS over the last"))));
  run_machine(60.0, 4e-6);
  EXPECT_FALSE(worker_->look(0)) << "once for an alarm";
}

TEST_F(DiagnosisWorkerTest, AnAlarmSoonAfterADiagnosisWaitsForNewMotion) {
  restart();
  run_machine(65.0);
  ASSERT_TRUE(worker_->look(0));
  run_machine(10.0, 4e-6);
  ASSERT_THAT(events("alarm_raised"), SizeIs(1));
  EXPECT_FALSE(worker_->look(0));
  run_machine(11.0, 4e-6);
  EXPECT_TRUE(worker_->look(0));
}

TEST_F(DiagnosisWorkerTest, AtTheEndHalfOfTheMotionIsEnough) {
  restart();
  run_machine(9.0);
  worker_->finish();
  EXPECT_THAT(events("diagnosis_begun"), IsEmpty());
  run_machine(3.0);
  worker_->finish();
  EXPECT_THAT(events("diagnosis_begun"), SizeIs(1));
}

TEST_F(DiagnosisWorkerTest, OnAFullDiskItIsPublishedAllTheSameAndSaid) {
  config_.record_s = 8.0;
  config_.encoder_in_loop_of["X"] = true;
  restart();
  std::mt19937_64 random(20);
  std::normal_distribution<> noise(0.0, 1e-7);
  Twin twin(drive());
  for (int i = 0; i < 9000; ++i) {
    CycleRow row;
    const double command = command_at(i * kCycle_s);
    if (i == 0) twin.start(command);
    const double error = i == 0 ? 0.0 : twin.follow(command);
    row.axes[0] = {command, command - error + noise(random), kAbsent};
    append(row);
  }
  {
    const FullDisk full;
    ASSERT_TRUE(worker_->look(0));
  }
  EXPECT_THAT(announced_, SizeIs(1)) << said_.str();
  EXPECT_THAT(said_.str(), HasSubstr("the diagnosis is published but could not be stored: store "));
  std::string why;
  const json made = json::parse(announced_.at(0).json);
  for (const json& one : made["not_observable"]) {
    if (one["id"] == "lead_error") why = one["why"];
  }
  EXPECT_THAT(why, HasSubstr("its own encoder"))
      << "as the configuration says of this axis, in " << made;
  EXPECT_TRUE(store_->diagnoses("X", 1).empty());
  std::string last_error;
  events_->update_last_error(last_error);
  EXPECT_THAT(last_error, HasSubstr("full"));
}

class LongDiagnosisWorkerTest : public DiagnosisWorkerTest {};

// The rig of the benchmark shares no code with the twin. Its ripple was put in by other formulas.
TEST_F(LongDiagnosisWorkerTest, AHiddenRippleIsNamedKeptAndThereAfterARestart) {
  using namespace hidden_effects;
  const Case hidden = single_case(Part::kDev, "cogging", Class::kClear, 0);
  std::ofstream(directory_.path() / "case.csv") << hidden.csv;
  const Recording recording = read_csv(directory_.path() / "case.csv", {});
  ASSERT_EQ(recording.axes.size(), 2U);
  machine_ = {hidden.sample_time_s, {{"X", false, ""}, {"Y", false, ""}}};
  config_.record_s = 10.0;
  config_.every_s = 1e6;
  restart();
  for (std::size_t i = 0; i < recording.time.size(); ++i) {
    CycleRow row;
    for (std::size_t axis = 0; axis < 2; ++axis)
      row.axes[axis] = {recording.axes[axis].command[i], recording.axes[axis].actual[i], kAbsent};
    append(row);
    // The machine is off for a while: that is not a loss of cycles.
    if (i == recording.time.size() / 4) rows_ += std::llround(20.0 / machine_.cycle_s);
  }
  ASSERT_TRUE(worker_->look(0)) << memory_->moved_s(0);
  ASSERT_EQ(announced_.size(), 1U) << said_.str();
  const StoredDiagnosis made = announced_[0];
  EXPECT_EQ(made.axis, "X");
  EXPECT_EQ(made.verdict, "explained");
  EXPECT_EQ(made.reason, "on schedule");
  const json told = json::parse(made.json);
  EXPECT_EQ(told["schema"], "servotwin.diagnosis/1");
  EXPECT_EQ(told["created"], made.time);
  EXPECT_EQ(told["reason"], "on schedule");
  ASSERT_FALSE(told["causes"].empty()) << said_.str();
  EXPECT_EQ(told["causes"][0]["id"], "cogging") << said_.str();
  for (const json& cause : told["causes"]) EXPECT_NE(cause["id"], "dropped_samples");
  EXPECT_NEAR(told["causes"][0]["parameters"]["period_m"].get<double>() /
                  hidden.hidden[0].parameters.at("period_m"),
              1.0, 0.02);
  const ModelRecord extended = model_from_json(json::parse(made.extended_model));
  EXPECT_NE(extended.model.find(kind_of<Cogging>()), nullptr);
  EXPECT_THAT(events("diagnosis"), ElementsAre(AllOf(HasSubstr("s, made in "), HasSubstr("named: "),
                                                     HasSubstr("; cogging: period "))));
  EXPECT_THAT(said_.str(), HasSubstr("servotwind: X: diagnosis of "));
  ASSERT_EQ(proposed_.size(), 1U) << "what was found is a candidate for the live twin";
  EXPECT_NE(proposed_[0].first.model.find(kind_of<Cogging>()), nullptr);
  EXPECT_THAT(proposed_[0].second, HasSubstr("cogging"));

  restart();
  worker_->restore();
  ASSERT_EQ(announced_.size(), 1U);
  EXPECT_EQ(announced_[0].json, made.json);
  EXPECT_EQ(announced_[0].extended_model, made.extended_model);
}

// The torque of a body of 10 kg with 3 N of friction on the recorded way, and a ripple of its own
// that the position loop is not asked about: by Newton, from differences of the command.
TEST_F(LongDiagnosisWorkerTest, TheTorqueIsExplainedWhereTheMachineSendsOne) {
  using namespace hidden_effects;
  const Case hidden = single_case(Part::kDev, "cogging", Class::kClear, 0);
  std::ofstream(directory_.path() / "case.csv") << hidden.csv;
  const Recording recording = read_csv(directory_.path() / "case.csv", {});
  machine_ = {hidden.sample_time_s, {{"X", false, "N"}}};
  config_.record_s = 10.0;
  config_.every_s = 1e6;
  restart();
  const std::vector<double>& x = recording.axes[0].command;
  const double h = hidden.sample_time_s, period = 0.02;
  for (std::size_t i = 2; i + 2 < x.size(); ++i) {
    const double v = (x[i + 1] - x[i - 1]) / (2.0 * h),
                 a = (x[i + 2] - 2.0 * x[i] + x[i - 2]) / (4.0 * h * h);
    const double torque =
        10.0 * a + 3.0 * std::tanh(v / 1e-3) + 2.0 * std::sin(2.0 * M_PI * x[i] / period);
    CycleRow row;
    row.axes[0] = {x[i], recording.axes[0].actual[i], torque};
    append(row);
  }
  ASSERT_TRUE(worker_->look(0)) << memory_->moved_s(0);
  ASSERT_EQ(announced_.size(), 1U) << said_.str();
  // The ripple in the position has another cause, and both are reported.
  EXPECT_THAT(events("diagnosis"),
              ElementsAre(AllOf(HasSubstr("; cogging: period 3.399"),
                                HasSubstr("by torque as well: "), HasSubstr("; period 20."))));
  const json told = json::parse(announced_[0].json);
  const auto by_torque =
      std::find_if(told["causes"].begin(), told["causes"].end(), [](const json& cause) {
        return cause["id"] == "cogging" && cause["gain"].contains("holdout_rms_before_n");
      });
  ASSERT_NE(by_torque, told["causes"].end()) << told["causes"].dump(1);
  const json line = (*by_torque)["parameters"]["harmonics"][0];
  EXPECT_NEAR(line["period_m"].get<double>(), period, 0.02 * period);
  EXPECT_NEAR(line["amplitude_n"].get<double>(), 2.0, 0.2);
}

}  // namespace
}  // namespace servotwin::daemon
