// A daemon that dies with offsets out: the real one as a process, a drive on CAN over UDP.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <numbers>

#include "daemon/clock.h"
#include "daemon/store.h"
#include "daemon/virtual_drive.h"
#include "drivers/can_encoder.h"
#include "drivers/can_udp.h"
#include "drivers/dds.h"
#include "tests/daemon/http_client.h"
#include "tests/daemon/support.h"
#include "tests/support/process.h"

namespace servotwin {
namespace {

constexpr const char* kToken = "a token of the test";
constexpr const char* kMap = R"(cycle_s = 0.001
[[axis]]
name = "X"
command = {id = 0x181, start_bit = 0, length = 32, unit = "nm*10"}
actual = {id = 0x181, start_bit = 32, length = 32, unit = "nm*10"}
target = {id = 0x301, start_bit = 0, length = 32, unit = "nm*10"}
offset = {id = 0x401, start_bit = 0, length = 32, unit = "nm*10", message_bytes = 4}
)";
constexpr double kPeak = 2e-4, kRate = 0.01;

/// 20 mm there and back, twice, between dwells.
double path_at(int k) {
  const double t = kCycle_s * (k - 300);
  return t < 0.0 || t > 4.0 ? 0.0 : 0.01 * (1.0 - std::cos(std::numbers::pi * t));
}
constexpr int kRows = 4600;

/// A port that is free now.
int free_port() { return CanUdp({"127.0.0.1:0", ""}).port(); }

class OffsetKill : public testing::Test {
 protected:
  OffsetKill() {
    std::ofstream(directory_.path() / "map.toml") << kMap;
    std::ofstream(directory_.path() / "m.toml")
        << "[machine]\nname = \"" << name_
        << "\"\n[[axis]]\nname = \"X\"\ncorrection = { peak = " << kPeak << ", rate = " << kRate
        << ", bandwidth = 100 }\n"
        << "[dds]\ndomain = 95\n[source.udp]\nmap = \"map.toml\"\nlisten = \"127.0.0.1:" << port_
        << "\"\npeer = \"127.0.0.1:" << bus_.port()
        << "\"\n"
        // A busy host may answer some cycles late: then the command is off by some of the offset.
        << "[ilc]\nlive = true\nmatch_tolerance = 4e-4\n"
        << "[http]\nlisten = \"127.0.0.1:0\"\ntoken = \"" << kToken << "\"\n";
    Store store(directory_.path() / "store", name_);
    ModelRecord record = record_of(drive());
    record.created = iso_time(wall_ns());
    store.promote(record, {record.created, "X", "model_promoted", "made for this test", ""});
  }

  /// One cycle of the controller, the drive and the bus. What the daemon has sent by now is heard.
  void cycle(double target) {
    const auto tell = [&](const CanFrame& frame) {
      for (const VirtualDrive::Answer& answer : drive_.on_frame(0, frame))
        out_.push_back(answer.frame);
    };
    std::array<CanFrame, 64> batch;
    for (std::size_t count = 1; count > 0;) {
      count = bus_.receive(batch, 0.0);
      for (std::size_t i = 0; i < count; ++i) tell(batch[i]);
    }
    ASSERT_TRUE(controller_.set(0, CanChannel::kTarget, target));
    out_ = {controller_.frame(map_.find(0, CanChannel::kTarget)->message), controller_.start()};
    for (const CanFrame& frame : std::vector<CanFrame>(out_)) tell(frame);
    bus_.send(out_);
    const MappedSignal* command = map_.find(0, CanChannel::kCommand);
    demand_ = decoded(command->signal, out_.back().data);
    usleep(1000);
  }
  /// What the drive adds to its target.
  [[nodiscard]] double added(double target) const { return demand_ - target; }

  void send_program(const DdsNode& node) {
    DdsWriter<ProgramChunk> writer(node);
    DdsReader<CorrectionChunk> reader(node);
    ASSERT_TRUE(writer.wait_for_readers(1, test::kPatience_s));
    ProgramChunk chunk;
    chunk.program = "part";
    chunk.learn = true;
    chunk.axes = {"X"};
    chunk.chunks = 5;
    for (int k = 0; k < kRows; ++k) {
      chunk.time_s.push_back(kCycle_s * k);
      chunk.command.push_back(path_at(k));
      if (chunk.time_s.size() == 1000 || k == kRows - 1) {
        ASSERT_TRUE(writer.write(chunk));
        ++chunk.chunk;
        chunk.time_s.clear();
        chunk.command.clear();
      }
    }
    CorrectionChunk correction;
    ASSERT_TRUE(reader.receive(correction, test::kPatience_s));
    ASSERT_EQ(correction.state, CorrectionState::kLearned) << correction.reason;
    ASSERT_EQ(correction.reason.find("not sent"), std::string::npos) << correction.reason;
  }

  TemporaryDirectory directory_;
  std::string name_ = "kill-" + std::to_string(getpid());
  int port_ = free_port();
  CanUdp bus_{{"127.0.0.1:0", "127.0.0.1:" + std::to_string(port_)}};
  CanMap map_ = check_can_map(kMap, "map.toml", "").map;
  CanEncoder controller_{map_};
  VirtualDrive drive_{map_, {Twin(drive())}};
  std::vector<CanFrame> out_;
  double demand_ = 0.0;
};

TEST_F(OffsetKill, ADriveRampsOutWhatADaemonThatWasKilledHasLeft) {
  test::Process daemon({test::built("servotwind"), "--config", directory_.path() / "m.toml",
                        "--store", directory_.path() / "store"});
  ASSERT_TRUE(daemon.says("page at http://127.0.0.1:")) << daemon.said();
  ASSERT_TRUE(daemon.says("X: model 1 is in force again")) << daemon.said();
  const std::string at = "page at http://127.0.0.1:";
  const auto port = static_cast<std::uint16_t>(
      std::stoi(daemon.said().substr(daemon.said().find(at) + at.size())));
  for (int k = 0; k < 1000; ++k) cycle(0.0);
  send_program(DdsNode({name_, 95, ""}));
  ASSERT_EQ(ask(port, "POST", "/api/v1/offsets/arm",
                std::string("Authorization: Bearer ") + kToken + "\r\n")
                .status,
            200);
  for (int k = 0; k < 200; ++k) cycle(0.0);

  // Until some of the correction has been out for a while.
  int k = 0;
  for (int out = 0; out < 200 && k < kRows; ++k) {
    cycle(path_at(k));
    out = std::abs(added(path_at(k))) > 0.25 * kPeak ? out + 1 : 0;
  }
  ASSERT_LT(k, kRows - 400) << "no offset came\n" << daemon.said();
  EXPECT_EQ(daemon.end(SIGKILL), 128 + SIGKILL);

  double before = added(path_at(k - 1));
  EXPECT_GT(std::abs(before), 0.25 * kPeak);
  const double most = kPeak / (VirtualDrive::kOffsetRamp_s / kCycle_s) + 2.1e-8;
  int gone = 0;  // cycles until nothing is added
  for (int after = 0; after < 300; ++after, ++k) {
    cycle(path_at(k));
    const double now = added(path_at(k));
    // The last one may still have been on its way.
    if (after > 1) {
      EXPECT_LE(std::abs(now - before), most) << after;
    }
    if (std::abs(now) > 1.1e-8) gone = after;
    before = now;
  }
  EXPECT_LE(gone, (VirtualDrive::kOffsetValidity_s + VirtualDrive::kOffsetRamp_s) / kCycle_s + 3);
  EXPECT_GE(gone, VirtualDrive::kOffsetRamp_s / kCycle_s - 1) << "a ramp, no step";
}

}  // namespace
}  // namespace servotwin
