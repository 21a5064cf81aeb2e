// CAN on the command line: the log of a bus as a recording, and logs and recordings onto a bus
// (UDP, which every host has).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <set>

#include "drivers/can/can_encoder.h"
#include "drivers/can/can_udp.h"
#include "drivers/recordings/can_log/candump.h"
#include "drivers/recordings/recording_file.h"
#include "tests/cli/program.h"
#include "tests/cli/recordings.h"
#include "tests/support/free_port.h"

namespace servotwin {
namespace {

using testing::HasSubstr;

const std::string kExamples = std::string(SERVOTWIN_SOURCE_DIR) + "/examples/";
const std::string kMap = kExamples + "can_machine.toml";
const std::string kTable = kExamples + "axis_production.csv";

/// The log that candump writes on the example machine's bus.
std::string log_of(const Recording& recording, const CanMap& map) {
  CanEncoder encoder(map);
  std::string text;
  for (std::size_t row = 0; row < recording.time.size(); ++row) {
    std::int64_t stamp = 1'700'000'000'000'000'000 + std::llround(1e9 * recording.time[row]);
    const auto add = [&](CanFrame frame) {
      frame.time_ns = stamp;
      stamp += 100'000;
      text += candump_line(frame, "can0") + "\n";
    };
    add(encoder.start());
    for (std::size_t i = 0; i < recording.axes.size(); ++i) {
      const AxisRecord& axis = recording.axes[i];
      encoder.set(i, CanChannel::kCommand, axis.command[row]);
      encoder.set(i, CanChannel::kActual, axis.actual[row]);
      encoder.set(i, CanChannel::kTorque, axis.torque[row]);
    }
    for (std::size_t m = 0; m < map.messages.size(); ++m) {
      if (map.messages[m].from_machine) add(encoder.frame(m));
    }
  }
  return text;
}

class CanOnTheCommandLine : public testing::Test {
 protected:
  Folder folder_;
  CanMap map_ = load_can_map(kMap);
  Recording recording_ = read_recording(kTable);
};

TEST_F(CanOnTheCommandLine, TheLogOfABusGivesTheModelOfTheRecording) {
  const std::string log = folder_.write("run.log", log_of(recording_, map_));
  const auto holdout = [&](const std::vector<std::string>& recording) {
    std::vector<std::string> arguments{"identify", "--method", "pole-search"};
    arguments.insert(arguments.end(), recording.begin(), recording.end());
    arguments.insert(arguments.end(), {"--axis", "X", "--json", "-"});
    const Answer answer = servotwin_says(arguments);
    EXPECT_EQ(answer.status, 0) << answer;
    return nlohmann::json::parse(answer.out)["fit"]["holdout"]["rms_m"].get<double>();
  };
  const double of_table = holdout({kTable});
  // The frames carry steps of 0.1 um, as the encoder of the recording does; commands are rounded.
  EXPECT_NEAR(holdout({log, "--can-map", kMap}), of_table, 0.01 * of_table);
}

TEST_F(CanOnTheCommandLine, ALogWithoutAMappingAndAMappingWithoutALog) {
  const auto says = [&](const std::vector<std::string>& arguments, int status, const char* what) {
    const Answer answer = servotwin_says(arguments);
    EXPECT_EQ(answer.status, status) << answer;
    EXPECT_THAT(answer.err, HasSubstr(what));
  };
  const std::string log = folder_.write("run.log", "(1.0) can0 080#\n");
  says({"identify", log, "--axis", "X"}, 2, "--can-map F.toml");
  says({"identify", kTable, "--axis", "X", "--can-map", kMap}, 2, "is for CAN logs");
  const std::string no_sync = folder_.write("a.log", "(1.0) can0 181#00\n");
  says({"identify", no_sync, "--axis", "X", "--can-map", kMap}, 1, "no frame with id 0x080");
}

TEST_F(CanOnTheCommandLine, EveryProblemOfAMappingIsALine) {
  const std::string log = folder_.write("run.log", "(1.0) can0 080#\n");
  const std::string map =
      folder_.write("bad.toml",
                    "cycle_s = -1\n[[bus]]\nname = \"can0\"\nspeed = 5\n[[axis]]\nname = \"X\"\n"
                    "command = {id = 0x181, start_bit = 0, length = 99, unit = \"um\"}\n");
  const Answer answer = servotwin_says({"identify", log, "--axis", "X", "--can-map", map});
  EXPECT_EQ(answer.status, 1) << answer;
  ASSERT_GE(answer.complaints().size(), 3U) << answer;
  for (const std::string& line : answer.complaints()) {
    EXPECT_TRUE(line.starts_with("servotwin identify: " + map + ":")) << line;
    EXPECT_EQ(line.find(map), line.rfind(map)) << line;
  }
}

/// The frames on the bus while the program runs. A busy host may delay it for seconds, so the wait
/// ends with the expected frames; further ones are received, too.
std::vector<CanFrame> heard(CanUdp& bus, Program& program, std::size_t expected, Answer& answer) {
  std::vector<CanFrame> all;
  std::array<CanFrame, 64> batch;
  const auto take = [&](double timeout_s) {
    const std::size_t count = bus.receive(batch, timeout_s);
    all.insert(all.end(), batch.begin(), batch.begin() + static_cast<std::ptrdiff_t>(count));
    return count > 0;
  };
  while (all.size() < expected && take(60.0)) {
  }
  answer = program.answer();
  while (take(0.0)) {
  }
  return all;
}

TEST_F(CanOnTheCommandLine, ReplaysALogAsItIs) {
  const std::string log =
      folder_.write("run.log",
                    "(10.0) can0 080#\n(10.001) can0 181#0102\n(10.002) can0 20000040#00\n"
                    "(10.003) can0 1F334455##10A0B\n(10.004) can0 123#R2\n");
  CanUdp bus({"127.0.0.1:0", ""});
  Program program({"replay", log, "--udp", "127.0.0.1:" + std::to_string(bus.port())});
  Answer answer;
  const auto frames = heard(bus, program, 4, answer);
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out, HasSubstr("sent 4 frames"));
  EXPECT_THAT(answer.out, HasSubstr("1 error frame not sent"));
  ASSERT_EQ(frames.size(), 4U);
  EXPECT_EQ(frames[1].data[1], 2);
  EXPECT_TRUE(frames[2].fd && frames[2].extended);
  EXPECT_TRUE(frames[3].remote);
}

TEST_F(CanOnTheCommandLine, ReplaysARecordingThroughAMapping) {
  CanUdp bus({"127.0.0.1:0", ""});
  Program program({"replay", kTable, "--can-map", kMap, "--to", "0.5", "--udp",
                   "127.0.0.1:" + std::to_string(bus.port())});
  Answer answer;
  const auto frames = heard(bus, program, 501U * 5, answer);
  EXPECT_EQ(answer.status, 0) << answer;
  ASSERT_EQ(frames.size(), 501U * 5);  // SYNC and two messages per axis
  EXPECT_EQ(frames[0].id, 0x80U);
  const MappedSignal& actual = *map_.find(1, CanChannel::kActual);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (frames[i].id != map_.messages[actual.message].id) continue;
    EXPECT_NEAR(decoded(actual.signal, frames[i].data), recording_.axes[1].actual[i / 5], 5.1e-8);
  }
}

// The controller of this test sends a SYNC; the virtual drives answer with what they measure.
TEST_F(CanOnTheCommandLine, SimulatedDrivesAnswerOverUdp) {
  write_model(folder_ / "x.json", known_axis("X"));
  write_model(folder_ / "y.json", known_axis("Y"));
  const std::string drives = "127.0.0.1:" + std::to_string(test::free_port());
  CanUdp bus({"127.0.0.1:0", drives});
  Program program({"simulate", "--model", folder_ / "x.json", "--model", folder_ / "y.json",
                   "--can-map", kMap, "--listen", drives, "--udp",
                   "127.0.0.1:" + std::to_string(bus.port())});
  const CanEncoder encoder(map_);
  const CanFrame sync = encoder.start();
  std::set<std::uint32_t> heard;
  std::array<CanFrame, 64> batch;
  for (int turn = 0; turn < 1500 && heard.size() < 4; ++turn) {
    (void)bus.send({&sync, 1});  // lost until the drives listen
    const std::size_t count = bus.receive(batch, 0.04);
    for (std::size_t i = 0; i < count; ++i) heard.insert(batch[i].id);
  }
  program.interrupt();
  const Answer answer = program.answer();
  EXPECT_EQ(answer.status, 0) << answer;
  EXPECT_EQ(heard, (std::set<std::uint32_t>{0x181, 0x182, 0x281, 0x282}));
}

}  // namespace
}  // namespace servotwin
