// The whole daemon in one process: frames over DDS, predictions back, models that come into force.
#include "daemon/service.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <future>
#include <map>
#include <random>
#include <thread>

#include "daemon/loop/scheduling.h"
#include "daemon/store/store.h"
#include "drivers/dds/dds.h"
#include "drivers/recordings/table/csv.h"
#include "tests/daemon/ball_screw.h"
#include "tests/daemon/support.h"
#include "twin/twin.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;

constexpr double kPatience_s =
    30.0;  // of a busy machine; nothing waits that long where all is well

class ServiceTest : public testing::Test {
 protected:
  ServiceTest() {
    config_.machine = "service-" + std::to_string(getpid());
    config_.dds.domain = 93;
    config_.store.directory = directory_.path();
    place_ = {config_.machine, config_.dds.domain, ""};
  }
  ~ServiceTest() override {
    if (service_.joinable()) stop();
  }

  void start() {
    stop_ = {};
    std::promise<void> ready;
    service_ = std::thread([this, &ready] {
      try {
        serve(
            config_, stop_.get_token(), [&] { ready.set_value(); }, said_);
      } catch (const std::exception& error) {
        failure_ = error.what();
      }
    });
    ready.get_future().wait();
  }
  void stop() {
    stop_.request_stop();
    service_.join();
  }
  void store_model(const Model& model) {
    Store store(directory_.path(), config_.machine);
    ModelRecord record = record_of(model);
    store.promote(record,
                  {"2026-01-31T12:00:00.000Z", "X", "model_promoted", "made for this test", ""});
  }

  TemporaryDirectory directory_;
  Config config_;
  DdsPlace place_;
  std::ostringstream said_;  // read after the service has stopped
  std::string failure_;
  std::stop_source stop_;
  std::thread service_;
};

/// A machine on the network whose axis X moves as in support.h.
class Machine {
 public:
  explicit Machine(const DdsNode& node)
      : descriptions_(node), frames_(node), predictions_(node), models_(node) {
    descriptions_.write(one_axis());
  }

  bool wait_for_daemon() { return frames_.wait_for_readers(1, kPatience_s); }
  void send(std::uint64_t k) {
    MachineFrame frame;
    frame.sequence = k;
    frame.time_ns = static_cast<std::int64_t>(k) * 1'000'000;
    frame.axis_count = 1;
    frame.axes[0].command = command_at(static_cast<double>(k) * kCycle_s);
    frame.axes[0].actual = frame.axes[0].command - 1e-6;
    EXPECT_TRUE(frames_.write(frame));
  }
  /// Sends cycle k, and returns what comes back for it.
  MachinePrediction cycle(std::uint64_t k) {
    send(k);
    MachinePrediction prediction;
    EXPECT_TRUE(predictions_.receive(prediction, kPatience_s));
    return prediction;
  }
  DdsReader<ModelAnnouncement>& models() { return models_; }

 private:
  DdsWriter<MachineDescription> descriptions_;
  DdsWriter<MachineFrame> frames_;
  DdsReader<MachinePrediction> predictions_;
  DdsReader<ModelAnnouncement> models_;
};

TEST_F(ServiceTest, PredictsWithTheModelItHadForAMachineThatIntroducesItself) {
  store_model(drive());
  start();
  const DdsNode node(place_);
  Machine machine(node);
  ASSERT_TRUE(machine.wait_for_daemon());
  ModelAnnouncement model;
  ASSERT_TRUE(machine.models().receive(model, kPatience_s));
  EXPECT_EQ(model.axis, "X");
  EXPECT_EQ(model.version, 1);
  EXPECT_EQ(model.reason, "made for this test");
  EXPECT_THAT(model.model_json, HasSubstr("servotwin.model/1"));

  Twin twin(drive());
  for (std::uint64_t k = 0; k < 500; ++k) {
    const double command = command_at(static_cast<double>(k) * kCycle_s);
    if (k == 0) twin.start(command);
    const double truth = k == 0 ? command - twin.position() : twin.follow(command);
    const MachinePrediction prediction = machine.cycle(k);
    ASSERT_EQ(prediction.sequence, k);
    ASSERT_EQ(prediction.axes[0].predicted_error, truth) << k;
    ASSERT_NEAR(prediction.axes[0].measured_error, 1e-6, 1e-12);
    ASSERT_EQ(prediction.axes[0].model_version, 1);
  }
  stop();
  EXPECT_EQ(failure_, "");
  EXPECT_THAT(said_.str(),
              HasSubstr("waiting for machine '" + config_.machine + "' on DDS domain 93"));
  EXPECT_THAT(said_.str(), HasSubstr("X: model 1 is in force again"));
  EXPECT_THAT(said_.str(), HasSubstr("stopped after 500 frames"));
}

TEST_F(ServiceTest, ADescriptionWithAnAbsurdCycleIsRefusedAndTheNextOneIsTaken) {
  start();
  const DdsNode node(place_);
  DdsWriter<MachineDescription> absurd(node);
  ASSERT_TRUE(absurd.write({1e-300, {{"X", false, ""}}}));
  const std::string refused = "the description of machine '" + config_.machine +
                              "' is refused: cycle_s must be 1e-05 to 1 s";
  const Store events(directory_.path(), config_.machine, StoreAccess::kRead);
  for (int i = 0; i < 600 && !events.events(1)[0].text.starts_with(refused); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  EXPECT_THAT(events.events(1)[0].text, HasSubstr(refused));
  Machine machine(node);
  EXPECT_TRUE(machine.wait_for_daemon());
  stop();
  EXPECT_EQ(failure_, "");
  EXPECT_THAT(said_.str(), HasSubstr("stopped after 0 frames"));
}

TEST_F(ServiceTest, SpeaksElsewhereThanWhereItsFramesComeFrom) {
  store_model(drive());
  config_.dds_in = DdsConfig{config_.dds.domain, "machines", 0};
  start();
  DdsPlace there = place_;
  there.partition = "machines";
  const DdsNode machines(there), people(place_);
  DdsWriter<MachineDescription> descriptions(machines);
  DdsWriter<MachineFrame> frames(machines);
  DdsReader<MachinePrediction> predictions(people), none(machines);
  ASSERT_TRUE(descriptions.write(one_axis()));
  ASSERT_TRUE(frames.wait_for_readers(1, kPatience_s));
  MachineFrame frame;
  frame.axis_count = 1;
  frame.axes[0].command = frame.axes[0].actual = 0.0;
  MachinePrediction prediction;
  for (int i = 0; i < 1000 && !predictions.receive(prediction, 0.05); ++i) {
    ++frame.sequence;
    frame.time_ns += 1'000'000;
    ASSERT_TRUE(frames.write(frame));
  }
  EXPECT_EQ(prediction.axes[0].model_version, 1);
  EXPECT_FALSE(none.receive(prediction, 0.05));
  stop();
  EXPECT_EQ(failure_, "");
}

/// Scheduling of the threads of this process whose name begins so.
std::vector<std::pair<int, int>> scheduling_of(const std::string& name) {
  std::vector<std::pair<int, int>> out;
  for (const auto& thread : std::filesystem::directory_iterator("/proc/self/task")) {
    std::ifstream comm(thread.path() / "comm");
    std::string its_name;
    std::getline(comm, its_name);
    const int id = std::stoi(thread.path().filename());
    sched_param parameter{};
    if (!its_name.starts_with(name) || sched_getparam(id, &parameter) != 0) continue;
    out.emplace_back(sched_getscheduler(id), parameter.sched_priority);
  }
  return out;
}

TEST_F(ServiceTest, FramesComeThroughRealTimeThreadsWhereThatIsPermitted) {
  config_.axes = {{"X", false, ""}};
  config_.priority = 40;
  start();
  const auto receiving = scheduling_of("recv");
  const bool permitted = real_time_refused(config_.priority).empty();
  stop();
  ASSERT_FALSE(receiving.empty());
  for (const auto& [policy, priority] : receiving) {
    EXPECT_EQ(policy, permitted ? SCHED_FIFO : SCHED_OTHER);
    EXPECT_EQ(priority, permitted ? 40 : 0);
  }
  EXPECT_EQ(said_.str().find("the DDS receive threads run at normal priority") == std::string::npos,
            permitted)
      << said_.str();
}

TEST_F(ServiceTest, SaysHowItIs) {
  config_.axes = {{"X", false, ""}};
  start();
  const DdsNode node(place_);
  Machine machine(node);
  ASSERT_TRUE(machine.wait_for_daemon());
  for (std::uint64_t k = 0; k < 100; ++k) machine.cycle(k);
  machine.cycle(110);
  machine.send(110);
  // It goes on until the end: after a second without a frame the daemon would be waiting.
  std::uint64_t k = 110;
  std::jthread goes_on([&](const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      machine.send(++k);
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  });
  DdsReader<MachineStatus> statuses(node);
  MachineStatus status;
  do {
    ASSERT_TRUE(statuses.receive(status, kPatience_s));
  } while (status.frames < 102);
  EXPECT_EQ(status.state, DaemonState::kRunning);
  EXPECT_EQ(status.lost, 10U);
  EXPECT_EQ(status.repeated, 1U);
  EXPECT_EQ(status.malformed, 0U);
  EXPECT_GT(status.work_p50_s, 0.0);
  EXPECT_GE(status.work_max_s, 0.9 * status.work_p50_s);
  ASSERT_EQ(status.axes.size(), 1U);
  EXPECT_EQ(status.axes[0].name, "X");
  EXPECT_EQ(status.axes[0].model_version, 0);
  // The first status with these frames may come before the worker has looked at them.
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(kPatience_s);
  while (status.axes[0].activity == "waiting for motion" &&
         std::chrono::steady_clock::now() < until)
    ASSERT_TRUE(statuses.receive(status, kPatience_s));
  EXPECT_THAT(status.axes[0].activity, HasSubstr("of 8.0 s of motion"));
  goes_on.request_stop();
  goes_on.join();
  while (status.frames < k - 8) ASSERT_TRUE(statuses.receive(status, kPatience_s));
  stop();
  while (statuses.receive(status, 0.2)) {
  }
  EXPECT_EQ(status.state, DaemonState::kStopping) << "the last thing it says";
  EXPECT_THAT(said_.str(), HasSubstr("stopped after " + std::to_string(k - 8) +
                                     " frames, 10 lost, 1 repeated and ignored\n"));
}

TEST_F(ServiceTest, StopsWhileItWaitsForAMachine) {
  start();
  stop();
  EXPECT_EQ(failure_, "");
  EXPECT_THAT(said_.str(), HasSubstr("stopped before a machine was found"));
}

TEST_F(ServiceTest, FromARecordingToAModelInForceThatIsThereAfterARestart) {
  const virtual_machine::AxisRecord record = ball_screw_record(20.0);
  Recording recording;
  AxisRecord x;
  x.name = "X";
  for (Eigen::Index i = 0; i < record.command.size(); ++i) {
    recording.time.push_back(static_cast<double>(i) * kCycle_s);
    x.command.push_back(record.command(i));
    x.actual.push_back(record.actual(i));
  }
  recording.axes = {x};
  write_recording_csv(directory_.path() / "machine.csv", recording);
  config_.source = SourceKind::kReplay;
  config_.replay.files = {directory_.path() / "machine.csv"};
  config_.replay.speed = 10.0;
  config_.diagnose.every_s = 0.0;

  const auto run = [&] {
    serve(
        config_, {}, [] {}, said_);
  };
  run();
  EXPECT_THAT(said_.str(), HasSubstr("X: model 1 is in force: residual "));
  EXPECT_THAT(said_.str(), HasSubstr("stopped after 20001 frames"));
  {
    const Store store(directory_.path(), config_.machine);
    ASSERT_EQ(store.in_force().size(), 1U) << said_.str();
    EXPECT_LT(store.in_force()[0].record.holdout.rms, 0.15e-6);
  }
  std::size_t rows = 0;
  for (const auto& file :
       std::filesystem::directory_iterator(directory_.path() / "recordings" / config_.machine)) {
    rows += read_csv(file.path(), {}).time.size();
  }
  EXPECT_EQ(rows, 20'001U) << "every row is recorded";

  said_.str("");
  run();
  EXPECT_THAT(said_.str(), HasSubstr("X: model 1 is in force again"));
  const Store store(directory_.path(), config_.machine);
  EXPECT_EQ(store.in_force()[0].record.version, 1) << "the same data makes no better model\n"
                                                   << said_.str();
}

// A drive that agrees with its model for 80 s of motion and then has twice the friction.
TEST_F(ServiceTest, GrownFrictionRaisesTheAlarmAndADiagnosisWhoComesLateReads) {
  store_model(drive());
  Recording recording;
  AxisRecord x;
  x.name = "X";
  Twin before(drive()), after(drive(20.0, 0.6));
  std::mt19937_64 random(20);
  std::normal_distribution<> noise(0.0, 2e-7);
  for (int i = 0; i < 110'000; ++i) {
    const double t = i * kCycle_s, command = command_at(t);
    if (i == 0) {
      before.start(command);
      after.start(command);
    }
    // Both axes move all the time: starting to follow in between would be a jump of the command.
    const double light = i == 0 ? 0.0 : before.follow(command);
    const double heavy = i == 0 ? 0.0 : after.follow(command);
    const double error = i < 80'000 ? light : heavy;
    recording.time.push_back(t);
    x.command.push_back(command);
    x.actual.push_back(command - error + noise(random));
  }
  recording.axes = {x};
  write_recording_csv(directory_.path() / "machine.csv", recording);
  config_.source = SourceKind::kReplay;
  config_.replay.files = {directory_.path() / "machine.csv"};
  config_.replay.speed = 50.0;
  config_.identify.window_s = config_.identify.memory_s = 3600.0;  // the model stays
  config_.diagnose.every_s = 0.0;
  config_.diagnose.record_s = 10.0;
  config_.diagnose.reference_s = 60.0;
  serve(
      config_, {}, [] {}, said_);
  EXPECT_THAT(said_.str(), HasSubstr("X: alarm: the residual has grown: "));
  EXPECT_THAT(said_.str(), HasSubstr("X: diagnosis begun, the residual has grown: "));
  std::string last;
  {
    const Store store(directory_.path(), config_.machine);
    const std::vector<StoredDiagnosis> made = store.diagnoses("X", 10);
    ASSERT_EQ(made.size(), 1U) << said_.str();
    EXPECT_THAT(made[0].reason, HasSubstr("the residual has grown: "));
    last = made[0].json;
  }
  // The daemon is restarted, and a reader joins after that.
  config_.source = SourceKind::kDds;
  config_.axes = {{"X", false, ""}};
  start();
  const DdsNode node(place_);
  DdsReader<DiagnosisAnnouncement> diagnoses(node);
  DiagnosisAnnouncement diagnosis;
  ASSERT_TRUE(diagnoses.receive(diagnosis, kPatience_s));
  EXPECT_EQ(diagnosis.axis, "X");
  EXPECT_EQ(diagnosis.diagnosis_json, last);
  stop();
}

TEST_F(ServiceTest, ReplaysEveryRowOfARecordingWithCoarseStamps) {
  std::ofstream file(directory_.path() / "coarse.csv");
  file.precision(12);
  file << "time[s],X.command[m],X.actual[m]\n";
  for (int k = 0; k < 3000; ++k) {
    const double command = command_at(k * kCycle_s);
    const int hundredths = k / 10;
    file << hundredths * 0.01 << ',' << command << ',' << command - 1e-6 << '\n';
  }
  file.close();
  config_.source = SourceKind::kReplay;
  config_.replay.files = {directory_.path() / "coarse.csv"};
  config_.replay.speed = 10.0;
  serve(
      config_, {}, [] {}, said_);
  EXPECT_THAT(said_.str(), HasSubstr("coarse.csv: stamps are only written to 10 ms"));
  EXPECT_THAT(said_.str(), HasSubstr("stopped after 3000 frames\n")) << "none lost or ignored";
  std::size_t rows = 0;
  for (const auto& recorded :
       std::filesystem::directory_iterator(directory_.path() / "recordings" / config_.machine)) {
    rows += read_csv(recorded.path(), {}).time.size();
  }
  EXPECT_EQ(rows, 3000U);
}

TEST_F(ServiceTest, WhatItCannotStartWithIsThrown) {
  config_.source = SourceKind::kReplay;
  config_.replay.files = {directory_.path() / "none.csv"};
  EXPECT_THAT(message_of([&] {
                serve(
                    config_, {}, [] {}, said_);
              }),
              HasSubstr("none.csv"));

  std::ofstream(directory_.path() / "file") << "not a directory";
  config_.store.directory = directory_.path() / "file";
  EXPECT_THAT(message_of([&] {
                serve(
                    config_, {}, [] {}, said_);
              }),
              HasSubstr("store "));
}

TEST_F(ServiceTest, AConfigurationForAnotherRecordingIsRefused) {
  Recording recording;
  recording.time = {0.0, 0.001, 0.002};
  recording.axes.push_back({"Y", false, {1.0, 2.0, 3.0}, {1.0, 2.0, 3.0}, {}, ""});
  write_recording_csv(directory_.path() / "y.csv", recording);
  config_.source = SourceKind::kReplay;
  config_.replay.files = {directory_.path() / "y.csv"};
  config_.axes = {{"X", false, ""}};
  EXPECT_EQ(message_of([&] {
              serve(
                  config_, {}, [] {}, said_);
            }),
            "axis 1 is 'X' in the configuration and 'Y' in the recording");
}

TEST(ThreadTable, NamesEveryThreadThatIsStarted) {
  const auto content = [](const char* file) {
    std::ostringstream text;
    text << std::ifstream(std::string(SERVOTWIN_SOURCE_DIR) + "/daemon/" + file).rdbuf();
    return text.str();
  };
  const std::string table = content("README.md"),
                    source = content("machine_service.cpp") + content("service_manager.cpp") +
                             content("web/web_service.cpp") + content("web/slow_answer.h");
  const std::string begin = "name_thread(\"";
  int threads = 0;
  for (std::size_t at = source.find(begin); at != source.npos; at = source.find(begin, at + 1)) {
    const std::size_t from = at + begin.size();
    EXPECT_THAT(table, HasSubstr("| " + source.substr(from, source.find('"', from) - from) + " |"));
    ++threads;
  }
  EXPECT_EQ(threads, 11);
}

}  // namespace
}  // namespace servotwin::daemon
