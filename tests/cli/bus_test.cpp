// servotwin replay and watch over DDS, with this test as the other side: daemon to the one, daemon
// and machine to the other. Recordings run at 100 Hz, so that a busy host does not overrun a
// reader's 64 messages.
#include <gmock/gmock.h>
#include <pty.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <thread>

#include "drivers/dds/dds.h"
#include "program.h"
#include "recordings.h"

namespace servotwin {
namespace {

using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr double kPatience_s = 30.0;  // for what must come; what does not come fails the test
constexpr double kCycle_s = 0.01;

/// A machine name of this test only, because tests run in parallel.
DdsPlace place() {
  const auto id = static_cast<std::uint32_t>(::getpid());
  return {"cli-test-" + std::to_string(id), 1 + id % 200, ""};
}

std::vector<std::string> over_dds(const std::string& command,
                                  const std::vector<std::string>& more) {
  std::vector<std::string> words{command,         "--dds",    "--machine",
                                 place().machine, "--domain", std::to_string(place().domain)};
  words.insert(words.end(), more.begin(), more.end());
  return words;
}

std::string slow_recording(int rows) {
  std::string table = "time[s],X.command[m],X.actual[m]\n";
  for (int k = 0; k < rows; ++k) {
    if (k == 120) continue;  // one cycle was lost
    table += cell(k * kCycle_s) + "," + cell(0.001 * k) + "," + cell(0.001 * k - 1e-5) + "\n";
  }
  return table;
}

TEST(Replay, IsTheMachineThatMadeTheRecording) {
  const Folder folder;
  const DdsNode node(place());
  DdsReader<MachineDescription> descriptions(node);
  DdsReader<MachineFrame> frames(node);
  DdsWriter<MachineStatus> statuses(node);
  Program replay(
      over_dds("replay", {folder.write("rec.csv", slow_recording(150)), "--look-ahead", "3"}));

  MachineDescription machine;
  ASSERT_TRUE(descriptions.receive(machine, kPatience_s));
  EXPECT_NEAR(machine.cycle_s, kCycle_s, 1e-12);
  ASSERT_EQ(machine.axes.size(), 1U);
  EXPECT_EQ(machine.axes[0].name, "X");

  // A daemon that has not published its axes is not ready: no frame may be sent before.
  MachineFrame frame;
  ASSERT_TRUE(statuses.wait_for_readers(1, kPatience_s));
  ASSERT_TRUE(statuses.write({}));
  EXPECT_FALSE(frames.receive(frame, 0.5));
  MachineStatus ready;
  ready.axes.push_back({"X", 0, kAbsent, "waiting"});
  ASSERT_TRUE(statuses.write(ready));
  std::uint64_t expected = 0;
  for (int k = 0; k < 149; ++k) {
    ASSERT_TRUE(frames.receive(frame, kPatience_s)) << "frame " << k;
    ASSERT_EQ(frame.sequence, expected);
    EXPECT_EQ(frame.axes[0].command, 0.001 * static_cast<double>(expected));
    EXPECT_EQ(frame.axes[0].actual, 0.001 * static_cast<double>(expected) - 1e-5);
    const std::uint64_t until =
        expected < 120 ? 119 : 149;  // commands are known up to the gap, or the end
    ASSERT_EQ(frame.ahead_count, std::min<int>(3, static_cast<int>(until - expected)));
    for (int i = 0; i < frame.ahead_count; ++i) {
      EXPECT_EQ(frame.ahead[0][static_cast<std::size_t>(i)],
                0.001 * static_cast<double>(expected + 1 + i));
    }
    expected = expected == 119 ? 121 : expected + 1;
  }
  const Answer answer = replay.answer();
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.err, IsEmpty());
  EXPECT_THAT(answer.out, HasSubstr("149 rows at 100 Hz, axis X"));
  EXPECT_THAT(answer.out, HasSubstr("sent 149 of 149 frames"));
}

// A daemon may be ready before its reader of frames is matched: a frame sent until then would be
// lost without being counted.
TEST(Replay, WaitsForWhoReadsItsFrames) {
  const Folder folder;
  const DdsNode node(place());
  DdsReader<MachineDescription> descriptions(node);
  DdsWriter<MachineStatus> statuses(node);
  Program replay(over_dds("replay", {folder.write("rec.csv", slow_recording(150))}));
  MachineDescription machine;
  ASSERT_TRUE(descriptions.receive(machine, kPatience_s));
  ASSERT_TRUE(statuses.wait_for_readers(1, kPatience_s));
  MachineStatus ready;
  ready.axes.push_back({"X", 0, kAbsent, "waiting"});
  ASSERT_TRUE(statuses.write(ready));
  std::this_thread::sleep_for(std::chrono::milliseconds(500));
  DdsReader<MachineFrame> frames(node);
  MachineFrame frame;
  for (int k = 0; k < 149; ++k) {
    ASSERT_TRUE(frames.receive(frame, kPatience_s)) << "frame " << k;
    ASSERT_EQ(frame.sequence, static_cast<std::uint64_t>(k < 120 ? k : k + 1));
  }
  EXPECT_EQ(replay.answer().status, 0);
}

TEST(Replay, NobodyThereIsAnError) {
  const Folder folder;
  const Answer answer = servotwin_says(
      over_dds("replay", {folder.write("rec.csv", slow_recording(150)), "--wait", "0.2"}));
  EXPECT_EQ(answer.status, 1);
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err, HasSubstr("no daemon listens to machine '" + place().machine + "'"));
  EXPECT_THAT(answer.err, HasSubstr("start servotwind"));
}

// Readers of frames receive those of all machines of a domain, so their presence proves nothing.
TEST(Replay, AMachineOfWhichThereIsNoDaemonIsAnErrorBesideDaemonsOfOthers) {
  const Folder folder;
  DdsPlace other = place();
  other.machine = "mill-7";
  const DdsNode node(other);
  const DdsReader<MachineFrame> frames(node);
  DdsWriter<MachineStatus> statuses(node);
  MachineStatus ready;
  ready.axes.push_back({"X", 0, kAbsent, "waiting"});
  ASSERT_TRUE(statuses.write(ready));
  const Answer answer = servotwin_says(
      over_dds("replay", {folder.write("rec.csv", slow_recording(10)), "--wait", "1"}));
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.out, testing::Not(HasSubstr("sent")));
  EXPECT_THAT(answer.err, HasSubstr("no daemon listens to machine '" + place().machine + "'"));
  EXPECT_THAT(answer.err, HasSubstr("in this domain there is a daemon of mill-7"));
}

TEST(Replay, ADaemonThatGoesBeforeTheEndIsAnError) {
  const Folder folder;
  const DdsNode node(place());
  const DdsReader<MachineDescription> descriptions(node);
  DdsReader<MachineFrame> frames(node);
  auto daemon = std::make_unique<DdsNode>(place());
  auto statuses = std::make_unique<DdsWriter<MachineStatus>>(*daemon);
  MachineStatus ready;
  ready.axes.push_back({"X", 0, kAbsent, "waiting"});
  ASSERT_TRUE(statuses->write(ready));
  Program replay(over_dds("replay", {folder.write("rec.csv", slow_recording(150))}));
  MachineFrame frame;
  for (int k = 0; k < 20; ++k) ASSERT_TRUE(frames.receive(frame, kPatience_s));
  statuses.reset();
  daemon.reset();
  const Answer answer = replay.answer();
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.out, HasSubstr("sent 149 of 149 frames"));
  EXPECT_THAT(answer.err, HasSubstr("stopped before the end"));
}

TEST(Replay, AListenerWithoutADaemonIsEnough) {
  const Folder folder;
  const DdsNode node(place());
  DdsReader<MachineFrame> frames(node);
  Program replay(over_dds("replay", {folder.write("rec.csv", slow_recording(10)), "--wait", "2"}));
  MachineFrame frame;
  for (int k = 0; k < 10; ++k) ASSERT_TRUE(frames.receive(frame, kPatience_s));
  const Answer answer = replay.answer();
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("no daemon serves"));
}

/// Daemon and machine of one axis whose errors are chosen, cycle by cycle.
class Stage {
 public:
  /// Without a machine the daemon replays recordings itself.
  explicit Stage(bool with_machine = true) {
    if (with_machine) frames_.emplace(node_);
    status_.axes.push_back({"X", 0, kAbsent, "collecting"});
    frame_.axis_count = prediction_.axis_count = 1;
  }

  /// Waits until the tool listens to everything.
  [[nodiscard]] bool watched() const {
    return (!frames_ || frames_->wait_for_readers(1, kPatience_s)) &&
           predictions_.wait_for_readers(1, kPatience_s) &&
           models_.wait_for_readers(1, kPatience_s) &&
           diagnoses_.wait_for_readers(1, kPatience_s) &&
           statuses_.wait_for_readers(1, kPatience_s);
  }

  void promote(int version, const std::string& reason) {
    ModelRecord record = known_axis();
    record.version = version;
    promote(version, reason, to_json(record).dump());
  }
  void promote(int version, const std::string& reason, const std::string& model_json) {
    models_.write({"X", version, version - 1, "2024-01-01T00:00:00Z", reason, model_json});
    version_ = version;
  }
  void diagnose(const std::string& diagnosis_json) { diagnoses_.write({"X", diagnosis_json}); }
  void say(const MachineStatus& status) { statuses_.write(status); }
  [[nodiscard]] MachineStatus& status() { return status_; }

  /// One cycle: the command, the measured error and the residual.
  void cycle(double command, double measured, double residual,
             AxisState state = AxisState::kPredicting) {
    frame_.sequence = prediction_.sequence = sequence_;
    frame_.time_ns = prediction_.time_ns =
        std::llround(static_cast<double>(sequence_) * kCycle_s * 1e9);
    ++sequence_;
    frame_.axes[0] = {command, command - measured, kAbsent};
    if (frames_) frames_->write(frame_);
    AxisPrediction& axis = prediction_.axes[0];
    axis = {measured - residual,
            1e-6,
            measured,
            residual,
            version_,
            version_ == 0 ? AxisState::kNoModel : state};
    if (version_ == 0) axis.predicted_error = axis.residual = kAbsent;
    predictions_.write(prediction_);
    std::this_thread::sleep_for(std::chrono::duration<double>(kCycle_s));
  }
  void skip() { ++sequence_; }

 private:
  DdsNode node_{place()};
  std::optional<DdsWriter<MachineFrame>> frames_;
  DdsWriter<MachinePrediction> predictions_{node_};
  DdsWriter<ModelAnnouncement> models_{node_};
  DdsWriter<DiagnosisAnnouncement> diagnoses_{node_};
  DdsWriter<MachineStatus> statuses_{node_};
  MachineFrame frame_;
  MachinePrediction prediction_;
  MachineStatus status_;
  std::uint64_t sequence_ = 0;
  int version_ = 0;
};

/// Predictions are best effort: a reader may miss the first ones, before it knows their writer.
constexpr int kMinPredictions = 136;

/// A run of known figures: 20 cycles without a model; 30 under version 1, of which 10 settle; 5
/// that settle under version 2, then 50 standing with a residual of 1 um, a lost one, and 50 moving
/// with 3 um.
void play(Stage& stage) {
  stage.status().frames = 155;
  stage.status().lost = 1;
  stage.status().repeated = 4;
  stage.status().wake_p50_s = 40e-6;
  stage.say(stage.status());
  for (int k = 0; k < 20; ++k) stage.cycle(0.0, 9e-3, 0.0);
  stage.promote(1, "first");
  for (int k = 0; k < 30; ++k) {
    stage.cycle(0.0, 8e-3, 7e-3, k < 10 ? AxisState::kSettling : AxisState::kPredicting);
  }
  stage.status().axes[0].refused = 1;
  stage.status().axes[0].last_refusal = "leaves more than version 1";
  stage.say(stage.status());
  stage.promote(2, "leaves less");
  for (int k = 0; k < 5; ++k) stage.cycle(0.0, 8e-3, 7e-3, AxisState::kSettling);
  for (int k = 0; k < 50; ++k) stage.cycle(0.0, 100e-6, k % 2 == 0 ? 1e-6 : -1e-6);
  stage.skip();
  for (int k = 0; k < 50; ++k) stage.cycle(0.001 * k, 200e-6, -3e-6);
}

TEST(Watch, TheSummaryHasTheFiguresOfTheModelInForce) {
  auto stage = std::make_unique<Stage>();
  Program watch(over_dds("watch", {"--summary", "--json"}));
  ASSERT_TRUE(stage->watched());
  play(*stage);
  stage.reset();  // machine and daemon leave the bus, and the watching ends by itself
  const Answer answer = watch.answer();
  ASSERT_EQ(answer.status, 0) << answer;

  const json summary = json::parse(answer.out);
  EXPECT_EQ(summary["schema"], "servotwin.watch/1");
  EXPECT_EQ(summary["machine"], place().machine);
  EXPECT_GE(summary["predictions"], kMinPredictions);
  EXPECT_LE(summary["predictions"], 155);
  EXPECT_EQ(summary["missed"], 1);
  EXPECT_EQ(summary["status"]["lost"], 1);
  EXPECT_EQ(summary["status"]["repeated"], 4);
  EXPECT_EQ(summary["status"]["wake_p50_s"], 40e-6);
  EXPECT_TRUE(summary["status"]["wake_p99_s"].is_null());
  EXPECT_GT(summary["latency"]["p50_s"].get<double>(), 0.0);
  EXPECT_GE(summary["latency"]["max_s"], summary["latency"]["p99_s"]);
  ASSERT_EQ(summary["axes"].size(), 1U);
  const json& axis = summary["axes"][0];
  EXPECT_EQ(axis["axis"], "X");
  EXPECT_EQ(axis["version"], 2);
  EXPECT_EQ(axis["model"]["schema"], "servotwin.model/1");
  EXPECT_EQ(axis["model"]["version"], 2);
  EXPECT_EQ(axis["cycles"], 100);
  EXPECT_EQ(axis["settling_cycles"], 5);
  EXPECT_NEAR(axis["with_model"]["rms_m"].get<double>(), 1e-6 * std::sqrt((1.0 + 9.0) / 2.0),
              1e-15);
  EXPECT_EQ(axis["with_model"]["max_m"], 3e-6);
  EXPECT_NEAR(axis["without_model"]["rms_m"].get<double>(), 1e-4 * std::sqrt((1.0 + 4.0) / 2.0),
              1e-12);
  EXPECT_EQ(axis["without_model"]["max_m"], 200e-6);
  EXPECT_EQ(axis["refused"], 1);
  EXPECT_THAT(axis["refusals"], ElementsAre("leaves more than version 1"));
  ASSERT_EQ(axis["promotions"].size(), 2U);
  EXPECT_EQ(axis["promotions"][1]["version"], 2);
  EXPECT_EQ(axis["promotions"][1]["reason"], "leaves less");
  // The cycles at the ends of the two runs have no velocity: span 1 cycle.
  EXPECT_EQ(axis["by_regime"]["standstill"]["cycles"], 48);
  EXPECT_NEAR(axis["by_regime"]["standstill"]["rms_m"].get<double>(), 1e-6, 1e-15);
  EXPECT_EQ(axis["by_regime"]["constant_speed"]["cycles"], 48);
  EXPECT_NEAR(axis["by_regime"]["constant_speed"]["share"].get<double>(), 0.9, 1e-12);
}

// A daemon that waits for its machine publishes through one writer, and through another one once
// the machine is there.
TEST(Watch, TheSummaryGoesOnWhereADaemonThatWaitedTakesUpItsMachine) {
  auto waiting = std::make_unique<Stage>(false);
  Program watch(over_dds("watch", {"--summary", "--json"}));
  ASSERT_TRUE(waiting->watched());
  waiting->say(waiting->status());
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  waiting.reset();
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  auto stage = std::make_unique<Stage>();
  ASSERT_TRUE(stage->watched());
  play(*stage);
  stage.reset();
  const Answer answer = watch.answer();
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_GE(json::parse(answer.out)["predictions"], kMinPredictions);
}

TEST(Watch, TheSummaryGoesOnOverAPauseOfADaemonThatReplaysItself) {
  auto stage = std::make_unique<Stage>(false);
  Program watch(over_dds("watch", {"--summary", "--json"}));
  ASSERT_TRUE(stage->watched());
  stage->promote(1, "first");
  for (int k = 0; k < 50; ++k) stage->cycle(0.0, 5e-6, 2e-6);
  std::this_thread::sleep_for(std::chrono::milliseconds(2500));
  for (int k = 0; k < 50; ++k) stage->cycle(0.0, 5e-6, 3e-6);
  stage.reset();
  const Answer answer = watch.answer();
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_EQ(json::parse(answer.out)["axes"][0]["with_model"]["max_m"], 3e-6) << answer;
}

TEST(Watch, TheSummaryIsForPeople) {
  auto stage = std::make_unique<Stage>();
  Program watch(over_dds("watch", {"--summary"}));
  ASSERT_TRUE(stage->watched());
  play(*stage);
  stage.reset();
  const Answer answer = watch.answer();
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.err, IsEmpty());
  for (const char* said :
       {"predictions at", "1 not received here", "lost 1, repeated 4",
        "axis X: model version 2 in force", "order 2: coulomb_friction, gravity_offset",
        "pair 25 Hz, damping 0.45", "2.236 um RMS", "3.00 um MAX", "158.114 um RMS",
        "71 times as much", "constant_speed  90.0 %", "standstill      10.0 %",
        "promoted    version 1: first", "promoted    version 2 after 1: leaves less",
        "refused     1 candidate:", "leaves more than version 1"}) {
    EXPECT_THAT(answer.out, HasSubstr(said));
  }
}

TEST(Watch, APipeGetsALinePerSecondUntilItIsInterrupted) {
  Stage stage;
  Program watch(over_dds("watch", {"--json"}));
  ASSERT_TRUE(stage.watched());
  stage.say(stage.status());
  stage.promote(1, "first");
  const auto give_up =
      std::chrono::steady_clock::now() + std::chrono::duration<double>(kPatience_s);
  const auto lines = [&] {
    const std::string so_far = watch.so_far();
    return std::count(so_far.begin(), so_far.end(), '\n');
  };
  while (lines() < 3 && std::chrono::steady_clock::now() < give_up) stage.cycle(0.0, 5e-6, 2e-6);
  watch.interrupt();
  const Answer answer = watch.answer();
  EXPECT_EQ(answer.status, 0) << answer;
  std::istringstream out(answer.out);
  std::string line;
  json last;
  while (std::getline(out, line)) {
    last = json::parse(line);
    EXPECT_EQ(last["schema"], "servotwin.watch/1");
  }
  ASSERT_EQ(last["axes"].size(), 1U) << answer;
  EXPECT_EQ(last["axes"][0]["state"], "predicting");
  EXPECT_NEAR(last["axes"][0]["with_model"]["rms_m"].get<double>(), 2e-6, 1e-15);
  EXPECT_NEAR(last["axes"][0]["without_model"]["rms_m"].get<double>(), 5e-6, 1e-15);
}

/// The output of the tool on a terminal, until it ends.
std::string on_a_terminal(const std::vector<std::string>& arguments,
                          const std::function<void()>& meanwhile) {
  std::vector<std::string> all{SERVOTWIN_BINARY};
  all.insert(all.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& one : all) argv.push_back(one.data());
  argv.push_back(nullptr);
  int terminal = -1;
  const pid_t id = forkpty(&terminal, nullptr, nullptr, nullptr);
  if (id == 0) {
    execv(argv[0], argv.data());
    _exit(127);
  }
  meanwhile();
  std::string out;
  char block[4096];
  // At its end a terminal is an error (EIO).
  for (ssize_t count = 0; (count = read(terminal, block, sizeof block)) > 0;)
    out.append(block, static_cast<std::size_t>(count));
  close(terminal);
  waitpid(id, nullptr, 0);
  return out;
}

TEST(Watch, OnATerminalThereIsATableThatIsWrittenOver) {
  Stage stage;
  const std::string out = on_a_terminal(over_dds("watch", {"--seconds", "4"}), [&] {
    ASSERT_TRUE(stage.watched());
    stage.say(stage.status());
    stage.promote(1, "first");
    for (int k = 0; k < 320; ++k) stage.cycle(0.0, 5e-6, 2e-6);
  });
  EXPECT_THAT(out, testing::ContainsRegex("X      um +5 +5 +3 +3 +2 +2   v1, predicting"));
  EXPECT_THAT(out, HasSubstr("contour error, predicted: not available"));
  EXPECT_THAT(out, HasSubstr("latency     frame sent to prediction sent p50 "));
  EXPECT_THAT(out, HasSubstr("lost 0"));
  EXPECT_THAT(out, HasSubstr("A\x1b[J"));  // the lines before it
}

TEST(Watch, PlainLinesNameAxisVersionAndErrors) {
  Stage stage;
  Program watch(over_dds("watch", {"--seconds", "3"}));
  ASSERT_TRUE(stage.watched());
  stage.say(stage.status());
  stage.promote(1, "first");
  for (int k = 0; k < 220; ++k) stage.cycle(0.0, 5e-6, 2e-6);
  const Answer answer = watch.answer();
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("X v1 predicting 2.000 of 5.0 um RMS  lost 0\n"));
  EXPECT_THAT(answer.out, testing::Not(HasSubstr("\x1b")));
}

TEST(Watch, WithoutAModelThereIsTheTrackingError) {
  Stage stage;
  Program watch(over_dds("watch", {"--seconds", "3"}));
  ASSERT_TRUE(stage.watched());
  stage.say(stage.status());
  for (int k = 0; k < 220; ++k) stage.cycle(0.0, 5e-6, 2e-6);
  const Answer answer = watch.answer();
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("X no model 5.0 um RMS tracking error  lost 0\n"));
}

TEST(Watch, AnAxisAtRestHasItsModelAndSilenceIsSaid) {
  Stage stage;
  Program watch(over_dds("watch", {"--seconds", "6"}));
  ASSERT_TRUE(stage.watched());
  stage.status().axes[0].model_version = 3;
  stage.say(stage.status());
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  stage.promote(3, "third");
  for (int k = 0; k < 120; ++k) stage.cycle(0.0, 5e-6, 2e-6);
  const Answer answer = watch.answer();
  EXPECT_EQ(answer.status, 0) << answer;
  const std::size_t before = answer.out.find("X v3 no frames"),
                    moving = answer.out.find("X v3 predicting"),
                    after = answer.out.rfind("X v3 no frames");
  EXPECT_LT(before, moving) << answer;
  EXPECT_LT(moving, after) << answer;
  EXPECT_NE(after, std::string::npos) << answer;
}

TEST(Watch, TheSummaryOfAMachineAtRestIsAScreen) {
  Stage stage;
  Program watch(over_dds("watch", {"--summary", "--seconds", "2"}));
  ASSERT_TRUE(stage.watched());
  stage.status().axes[0].model_version = 1;
  stage.say(stage.status());
  stage.promote(1, "first");
  const Answer answer = watch.answer();
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.out, HasSubstr(": no frames came in 2 s\n"));
  EXPECT_THAT(answer.out, HasSubstr("axis X: model version 1 in force\n"));
  EXPECT_THAT(answer.out, HasSubstr("now         collecting\n"));
  EXPECT_THAT(answer.err, HasSubstr("a daemon is running, but receives no frames"));
}

TEST(Watch, ADaemonThatGoesEndsTheSummaryAndIsSaidInTheLines) {
  auto stage = std::make_unique<Stage>();
  Program summary(over_dds("watch", {"--summary"}));
  ASSERT_TRUE(stage->watched());
  Program lines(over_dds("watch", {"--seconds", "6"}));
  std::this_thread::sleep_for(std::chrono::seconds(1));  // until both listen
  stage->status().axes[0].model_version = 3;
  stage->say(stage->status());
  std::this_thread::sleep_for(std::chrono::seconds(2));
  stage.reset();
  const Answer ended = summary.answer();
  EXPECT_EQ(ended.status, 1) << ended;
  EXPECT_THAT(ended.out, HasSubstr("the daemon has stopped"));
  EXPECT_THAT(ended.err, HasSubstr("its daemon has stopped"));
  const Answer told = lines.answer();
  EXPECT_LT(told.out.find("X v3 no frames"), told.out.find("X v3 no daemon")) << told;
}

TEST(Watch, WhatIsPromotedInSilenceIsShown) {
  Stage stage;
  Program watch(over_dds("watch", {"--seconds", "5"}));
  ASSERT_TRUE(stage.watched());
  stage.status().axes[0].model_version = 1;
  stage.say(stage.status());
  stage.promote(1, "first");
  for (int k = 0; k < 120; ++k) stage.cycle(0.0, 5e-6, 2e-6);
  stage.status().axes[0].model_version = 2;
  stage.say(stage.status());
  const Answer answer = watch.answer();
  EXPECT_LT(answer.out.find("X v1 predicting"), answer.out.find("X v2 no frames")) << answer;
}

TEST(Watch, TheLastDiagnosisIsALineOfItsAxis) {
  for (const auto& [given, shown] :
       {std::pair{R"({"verdict":"explained","causes":[{"id":"cogging"},{"id":"presliding"}],)"
                  R"("created":"2026-01-31T12:00:00.000Z"})",
                  "diagnosis   explained: cogging, presliding (2026-01-31T12:00:00.000Z)"},
        {R"({"verdict":"nothing_significant","causes":[]})", "diagnosis   nothing_significant ()"},
        {"{", "diagnosis   cannot be read: "}}) {
    auto stage = std::make_unique<Stage>();
    Program watch(over_dds("watch", {"--summary"}));
    ASSERT_TRUE(stage->watched());
    stage->diagnose(given);
    stage->say(stage->status());
    for (int k = 0; k < 50; ++k) stage->cycle(0.0, 5e-6, 2e-6);
    stage.reset();
    const Answer answer = watch.answer();
    EXPECT_EQ(answer.status, 0) << answer;
    EXPECT_THAT(answer.out, HasSubstr(shown));
  }
}

TEST(Watch, AModelThatCannotBeReadIsSaidAndTheFiguresStay) {
  auto stage = std::make_unique<Stage>();
  Program watch(over_dds("watch", {"--summary"}));
  ASSERT_TRUE(stage->watched());
  stage->say(stage->status());
  stage->promote(1, "first", R"({"schema": "servotwin.model/9"})");
  for (int k = 0; k < 50; ++k) stage->cycle(0.0, 5e-6, 2e-6);
  stage.reset();
  const Answer answer = watch.answer();
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out,
              HasSubstr("version 1 in force, model file: schema: is \"servotwin.model/9\""));
  EXPECT_THAT(answer.out, HasSubstr("2.000 um RMS"));
}

TEST(Watch, SilenceIsAnError) {
  const Answer answer = servotwin_says(over_dds("watch", {"--seconds", "0.3"}));
  EXPECT_EQ(answer.status, 1);
  EXPECT_THAT(answer.out, IsEmpty());
  ASSERT_EQ(answer.complaints().size(), 1U) << answer;
  EXPECT_THAT(answer.err,
              HasSubstr("no prediction was received for machine '" + place().machine + "'"));
}

}  // namespace
}  // namespace servotwin
