// servotwind on a CAN bus, as a user has it: the real programs on virtual interfaces, with candump
// beside them; what is counted is held against what was sent, and what the wire shows.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <thread>

#include "daemon/store/store.h"
#include "drivers/can/can_encoder.h"
#include "drivers/recordings/can_log/can_log.h"
#include "drivers/recordings/recording_file.h"
#include "identification/model/model_file.h"
#include "tests/daemon/http_client.h"
#include "tests/daemon/prometheus_text.h"
#include "tests/daemon/support.h"
#include "tests/support/process.h"
#include "tests/vcan/support.h"

namespace servotwin {
namespace {

using nlohmann::json;
using test::built;
using test::ip;
using test::Process;
using testing::AllOf;
using testing::HasSubstr;

const std::string kRecording = SERVOTWIN_SOURCE_DIR "/examples/axis_production.csv";
constexpr const char* kMachine = "vcan-test";
constexpr double kPatience_s = 60.0;  // for what must come; what does not come fails the test

/// examples/can_machine.toml with another cycle, and a deadline that a host which holds the sender
/// up within a cycle does not miss: the next SYNC ends a cycle in any case.
std::string example_map(double cycle_s) {
  std::ifstream in(SERVOTWIN_SOURCE_DIR "/examples/can_machine.toml");
  std::string text{std::istreambuf_iterator<char>(in), {}};
  const std::string cycle = "cycle_s = 0.001";
  text.replace(text.find(cycle), cycle.size(),
               "cycle_s = " + std::to_string(cycle_s) + "\ndeadline_s = 1.0");
  return text;
}

bool wait_for(const std::function<bool()>& condition) {
  const auto until = std::chrono::steady_clock::now() + std::chrono::duration<double>(kPatience_s);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > until) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return true;
}

/// candump -L into a file.
class Candump {
 public:
  explicit Candump(std::string file)
      : file_(std::move(file)),
        process_({"candump", "-L", "-r", "8388608", "vcan0"}, {.output = file_}) {
    // It listens when it has seen a frame of ours, which the log then begins with.
    SocketCan bus("vcan0");
    const CanFrame knock = test::frame_of(0x7FF, {});
    EXPECT_TRUE(wait_for([&] {
      bus.send({&knock, 1});
      return std::filesystem::exists(file_) && std::filesystem::file_size(file_) > 0;
    }));
  }
  /// Its lines but for the ones of the constructor, once it has `frames` of them; in a file.
  std::vector<CandumpLine> log(std::size_t frames, const std::string& file) {
    std::vector<CandumpLine> lines;
    EXPECT_TRUE(wait_for([&] {
      lines.clear();
      CanLogReader reader(file_);
      for (CandumpLine line; reader.next(line);) {
        if (line.frame.id != 0x7FF) lines.push_back(line);
      }
      return lines.size() >= frames;
    })) << lines.size()
        << " frames in the log";
    (void)process_.end(SIGTERM);
    std::ofstream out(file);
    for (const CandumpLine& line : lines) out << candump_line(line.frame, line.interface) << '\n';
    return lines;
  }

 private:
  std::string file_;
  Process process_;
};

class DaemonOnCan : public testing::Test {
 protected:
  [[nodiscard]] std::string file(const std::string& name) const { return directory_.path() / name; }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(directory_.path() / name) << text;
    return file(name);
  }
  /// The model that the daemon will begin with.
  void in_force(ModelRecord record) {
    daemon::Store store(file("store"), kMachine);
    store.promote(record,
                  {"2026-01-31T12:00:00.000Z", record.axis, "model_promoted", "for this test", ""});
  }
  void start(double cycle_s) {
    map_ = write("map.toml", example_map(cycle_s));
    const std::string config = write("daemon.toml",
                                     "[source.can]\nmap = \"map.toml\"\ninterfaces = [\"vcan0\"]\n"
                                     "[diagnose]\nevery_s = 0\nfalse_alarm_days = 0\n");
    daemon_.emplace(std::vector<std::string>{built("servotwind"), "--config", config, "--store",
                                             file("store"), "--machine", kMachine, "--domain", "97",
                                             "--http", "127.0.0.1:0"});
    ASSERT_TRUE(daemon_->says("listening to vcan0")) << daemon_->said();
    const std::string place = "page at http://127.0.0.1:";
    const std::string& said = daemon_->said();
    ASSERT_NE(said.find(place), said.npos) << said;
    port_ = static_cast<std::uint16_t>(std::stoi(said.substr(said.find(place) + place.size())));
    // The loop is about to wait for the bus.
    ASSERT_TRUE(
        wait_for([&] { return status()["axes"].size() == 2 && !status()["buses"].empty(); }));
  }
  [[nodiscard]] json status() const { return daemon::ask(port_, "GET", "/api/v1/status").json(); }
  [[nodiscard]] json bus() const { return status()["buses"][0]; }
  /// Waits until so many cycles have come; the status then.
  json after_cycles(std::uint64_t cycles) {
    json now;
    EXPECT_TRUE(wait_for([&] { return (now = status())["frames"].get<std::uint64_t>() >= cycles; }))
        << now.dump(1) << daemon_->said();
    return now;
  }
  void stop() { EXPECT_EQ(daemon_->end(SIGTERM), 0) << daemon_->said(); }

  test::TemporaryDirectory directory_;
  std::string map_;
  std::optional<Process> daemon_;
  std::uint16_t port_ = 0;
};

/// Cycles that are missing between the SYNCs on the wire, by their stamps.
std::uint64_t missing_on_the_wire(const std::vector<CandumpLine>& log, double cycle_s) {
  std::uint64_t missing = 0;
  std::int64_t last = 0;
  for (const CandumpLine& line : log) {
    if (line.frame.id != 0x80) continue;
    const double cycles = 1e-9 * static_cast<double>(line.frame.time_ns - last) / cycle_s;
    if (last != 0 && cycles > 1.5) missing += static_cast<std::uint64_t>(std::llround(cycles)) - 1;
    last = line.frame.time_ns;
  }
  return missing;
}

/// The example recording at 50 Hz, which a guest holds on a busy host too: each twentieth row of
/// it.
std::string at_50_hz(std::size_t cycles) {
  std::ifstream in(kRecording);
  std::string text, line;
  std::size_t row = 0;
  while (row < 20 * cycles && std::getline(in, line)) {
    const bool is_row = line[0] >= '0' && line[0] <= '9';
    if (!is_row || row++ % 20 == 0) text += line + "\n";
  }
  return text;
}

TEST_F(DaemonOnCan, TakesInAReplayedMachineWithoutLossPredictsItAndItsLogReadsBack) {
  constexpr std::size_t kCycles = 1000;
  constexpr double kCycle = 0.02;
  for (const std::string axis : {"X", "Y"}) {
    Process identify({built("servotwin"), "identify", kRecording, "--axis", axis, "--method",
                      "pole-search", "--model", file(axis + ".json")});
    ASSERT_EQ(identify.end(), 0) << identify.said();
    ModelRecord record = read_model(file(axis + ".json"));
    record.model.sample_time_s = kCycle;
    in_force(record);
  }
  Candump candump(file("whole.log"));
  start(kCycle);
  const std::string motion = write("motion.csv", at_50_hz(kCycles));
  Process replay({built("servotwin"), "replay", motion, "--can", "vcan0", "--can-map", map_});
  // A second in which the machine moves and most of its error is predicted.
  json seen;
  EXPECT_TRUE(wait_for([&] {
    seen = status()["axes"][0]["last_second"];
    const json &measured = seen["measured"]["rms_m"], &residual = seen["residual"]["rms_m"];
    return residual.is_number() && measured > 1e-4 && residual < 0.05 * measured.get<double>();
  })) << seen.dump(1);
  EXPECT_EQ(replay.end(), 0) << replay.said();

  const json now = after_cycles(kCycles);
  const auto log = candump.log(5 * kCycles, file("can.log"));
  EXPECT_EQ(log.size(), 5 * kCycles) << "SYNC and two messages per axis";
  EXPECT_EQ(now["frames"], kCycles);
  EXPECT_EQ(now["lost"], missing_on_the_wire(log, kCycle)) << replay.said();
  EXPECT_EQ(now["malformed"], 0);
  EXPECT_EQ(now["not_finite"], 0);
  // Its own identification may have found a better one by then.
  EXPECT_GE(now["axes"][0]["model_version"], 1);
  EXPECT_GE(now["axes"][1]["model_version"], 1);
  const json bus = now["buses"][0];
  EXPECT_EQ(bus["name"], "vcan0");
  EXPECT_EQ(bus["frames"], 5 * kCycles);
  EXPECT_EQ(bus["dropped"], 0);
  EXPECT_EQ(bus["missing"], 0);
  EXPECT_EQ(bus["unexpected"], 0);
  // A prediction of every cycle but for those that are counted as dropped.
  const auto metrics = daemon::read_prometheus(daemon::ask(port_, "GET", "/metrics").body);
  const double published = metrics.at("servotwin_publish_seconds").samples.back().value;
  const double dropped = metrics.at("servotwin_predictions_dropped_total").samples[0].value;
  EXPECT_EQ(published + dropped, static_cast<double>(kCycles));
  EXPECT_GT(published, 0.9 * kCycles);
  EXPECT_GT(now["publish_p50_s"].get<double>(), 0.0);
  stop();
  EXPECT_THAT(daemon_->said(), HasSubstr("stopped after 1000 frames"));

  ReadOptions of_log;
  of_log.can_map = map_;
  const Recording read_back = read_recording(file("can.log"), of_log);
  const Recording played = read_recording(motion);
  ASSERT_EQ(read_back.time.size(), kCycles);
  for (std::size_t a = 0; a < 2; ++a) {
    for (std::size_t k = 0; k < kCycles; ++k) {
      // Half a step of what the frames carry.
      ASSERT_NEAR(read_back.axes[a].command[k], played.axes[a].command[k], 0.0501e-6) << k;
      ASSERT_NEAR(read_back.axes[a].actual[k], played.axes[a].actual[k], 0.0501e-6) << k;
      ASSERT_NEAR(read_back.axes[a].torque[k], played.axes[a].torque[k], 0.501e-3) << k;
    }
  }
}

/// A loop without friction, slow enough for 20 Hz.
ModelRecord slow_axis(const std::string& axis) {
  Model model;
  model.sample_time_s = 0.05;
  model.loop.order = 2;
  model.loop.denominator = denominator_of({0.0, 8.0 * 2.0 * std::numbers::pi, 0.6}, 2);
  model.loop.numerator = {1.0, model.loop.denominator[0], 0.0};
  return daemon::record_of(model, axis);
}

/// Two axes; the errors are of no drive.
std::string slow_motion(int cycles, double cycle_s) {
  std::string text =
      "time[s],X.command[mm],X.actual[mm],X.torque[Nm],Y.command[mm],Y.actual[mm],Y.torque[Nm]\n";
  for (int k = 0; k < cycles; ++k) {
    const double t = cycle_s * k;
    const double x = 10.0 * (1.0 - std::cos(2.0 * t)), y = 8.0 * (1.0 - std::cos(1.7 * t));
    char line[160];
    std::snprintf(line, sizeof line, "%.2f,%.4f,%.4f,1.5,%.4f,%.4f,-0.5\n", t, x, x - 0.01, y,
                  y + 0.02);
    text += line;
  }
  return text;
}

TEST_F(DaemonOnCan, DrivesThatAnswerAControllerArePredictedByTheirModels) {
  constexpr int kCycles = 400;
  constexpr double kCycle = 0.05;  // of which a busy host leaves some whole
  std::vector<std::string> drives{built("servotwin"), "simulate",      "--can", "vcan0",
                                  "--can-map",        file("map.toml")};
  std::vector<std::string> beside{built("servotwin"), "watch",          "--can",   "vcan0",
                                  "--can-map",        file("map.toml"), "--model", file("Y.json")};
  for (const std::string axis : {"X", "Y"}) {
    in_force(slow_axis(axis));
    drives.insert(drives.end(),
                  {"--model", write(axis + ".json", to_json(slow_axis(axis)).dump())});
  }
  start(kCycle);
  Process simulate(drives);
  ASSERT_TRUE(simulate.says("answering on vcan0")) << simulate.said();
  Process watch(beside);
  ASSERT_TRUE(watch.says("0 cycles, 0 incomplete")) << watch.said();
  Process replay({built("servotwin"), "replay", write("motion.csv", slow_motion(kCycles, kCycle)),
                  "--can", "vcan0", "--can-map", map_, "--targets"});
  // Of each a second in which it moves and is predicted to half a step of the encoder: all else is
  // as the model says.
  json now;
  std::vector<bool> predicted(2, false);
  EXPECT_TRUE(wait_for([&] {
    now = status();
    for (std::size_t i = 0; i < 2; ++i) {
      const json& seen = now["axes"][i]["last_second"];
      if (seen["residual"]["max_m"].is_number() && seen["measured"]["max_m"] > 1e-4 &&
          seen["residual"]["max_m"] < 0.051e-6) {
        predicted[i] = true;
      }
    }
    return predicted[0] && predicted[1];
  })) << now.dump(1);
  EXPECT_EQ(replay.end(), 0) << replay.said();
  now = after_cycles(kCycles);
  EXPECT_EQ(now["frames"], kCycles);
  // Targets of two axes, SYNC, and the drives' two answers each.
  EXPECT_EQ(now["buses"][0]["frames"], 7 * kCycles);
  EXPECT_EQ(now["buses"][0]["dropped"], 0);
  EXPECT_EQ(watch.end(SIGINT), 0);
  // It predicts the axis whose model it was given.
  EXPECT_THAT(watch.said(), testing::ContainsRegex("error [0-9.]+ um RMS [0-9.]+ MAX; Y "));
  EXPECT_THAT(watch.said(),
              testing::ContainsRegex("Y [0-9.]+ mm, error [0-9.]+ um RMS [0-9.]+ MAX, "
                                     "not predicted [0-9.]+ um RMS"));
  EXPECT_EQ(simulate.end(SIGINT), 0);
  EXPECT_THAT(simulate.said(),
              HasSubstr("answered in 400 cycles, 0 frames not sent, 0 values did not fit"));
  stop();
}

/// What a machine of 100 Hz says, as a log; node 2 says nothing in cycles [from, to).
std::string log_of_a_machine(const std::string& map_file, int cycles, int from, int to) {
  const CanMap map = load_can_map(map_file);
  CanEncoder encoder(map);
  std::string text;
  for (int k = 0; k < cycles; ++k) {
    std::int64_t stamp = 1'700'000'000'000'000'000 + 10'000'000LL * k;
    const auto add = [&](CanFrame frame) {
      frame.time_ns = stamp;
      stamp += 200'000;
      text += candump_line(frame, "can0") + "\n";
    };
    add(encoder.start());
    for (std::size_t a = 0; a < 2; ++a) {
      encoder.set(a, CanChannel::kCommand, 1e-5 * k);
      encoder.set(a, CanChannel::kActual, 1e-5 * k - 3e-6);
    }
    for (std::size_t m = 0; m < map.messages.size(); ++m) {
      const bool silent = k >= from && k < to && (map.messages[m].id & 0x7F) == 2;
      if (map.messages[m].from_machine && !silent) add(encoder.frame(m));
    }
  }
  return text;
}

TEST_F(DaemonOnCan, ANodeThatFallsSilentIsNamedAndTheOtherAxisGoesOn) {
  constexpr int kCycles = 700, kFrom = 200, kTo = 500;
  start(0.01);
  Process replay({built("servotwin"), "replay",
                  write("run.log", log_of_a_machine(map_, kCycles, kFrom, kTo)), "--can", "vcan0"});
  ASSERT_TRUE(daemon_->says("fell silent")) << daemon_->said();
  // The last second holds cycles of the silence only after a second of it.
  json silent;
  EXPECT_TRUE(wait_for([&] {
    silent = status();
    return silent["axes"][1]["last_second"]["measured"]["rms_m"].is_null() &&
           silent["axes"][0]["last_second"]["measured"]["rms_m"].is_number();
  })) << silent.dump(1);
  EXPECT_NEAR(silent["axes"][0]["last_second"]["measured"]["rms_m"].get<double>(), 3e-6, 0.1e-6);
  EXPECT_EQ(silent["state"], "running");
  EXPECT_GT(bus()["missing"], 0);
  ASSERT_TRUE(daemon_->says("is back")) << daemon_->said();
  EXPECT_EQ(replay.end(), 0) << replay.said();
  const json now = after_cycles(kCycles);
  EXPECT_EQ(now["frames"], kCycles);
  EXPECT_EQ(now["buses"][0]["missing"], 2 * (kTo - kFrom)) << "two messages of the node";
  EXPECT_EQ(now["buses"][0]["dropped"], 0);
  const std::string events = daemon::ask(port_, "GET", "/api/v1/events").body;
  EXPECT_THAT(events, AllOf(HasSubstr("0x182"), HasSubstr("0x282"), HasSubstr("fell silent"),
                            HasSubstr("is back")));
  EXPECT_THAT(events, testing::Not(HasSubstr("0x181")));
  EXPECT_THAT(daemon_->said(), HasSubstr("axis Y"));
  stop();
}

TEST_F(DaemonOnCan, TheInterfaceGoesDownAndUpAndTheMachineIsThereAgain) {
  start(0.01);
  const std::string motion = write("motion.csv", slow_motion(200, 0.01));
  const auto play = [&] {
    Process replay({built("servotwin"), "replay", motion, "--can", "vcan0", "--can-map", map_});
    EXPECT_EQ(replay.end(), 0) << replay.said();
  };
  play();
  EXPECT_EQ(after_cycles(200)["frames"], 200);
  ip("link set vcan0 down");
  ASSERT_TRUE(daemon_->says("vcan0: the interface went down or was removed")) << daemon_->said();
  ASSERT_TRUE(daemon_->says("no cycle starts: 0x080 on vcan0")) << daemon_->said();
  json down;
  // Both of one status: the bus counts are taken at another moment than the machine's state.
  EXPECT_TRUE(wait_for([&] {
    down = status();
    return down["state"] == "waiting" && down["buses"][0]["up"] == false;
  })) << down.dump(1);
  EXPECT_EQ(down["buses"][0]["downs"], 1);
  // Who sends meanwhile is told that it cannot.
  Process nobody(
      {built("servotwin"), "replay", motion, "--can", "vcan0", "--can-map", map_, "--to", "0.05"});
  EXPECT_EQ(nobody.end(), 1);
  EXPECT_THAT(nobody.said(), HasSubstr("the bus refused 30 frames"));
  ip("link set vcan0 up");
  play();
  ASSERT_TRUE(daemon_->says("vcan0: the interface is up again")) << daemon_->said();
  ASSERT_TRUE(daemon_->says("cycles start again with 0x080 on vcan0")) << daemon_->said();
  const json now = after_cycles(400);
  EXPECT_EQ(now["frames"], 400);
  EXPECT_EQ(now["state"], "running");
  EXPECT_EQ(now["buses"][0]["up"], true);
  EXPECT_EQ(now["buses"][0]["frames"], 2000);
  EXPECT_EQ(now["buses"][0]["missing"], 0);
  EXPECT_GT(now["lost"], 0) << "the cycles of the pause";
  stop();
}

}  // namespace
}  // namespace servotwin
