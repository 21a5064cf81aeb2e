// The real daemon on a machine with two clocks: commands by DDS, the encoder by CAN over UDP.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <vector>

#include "daemon/config/config.h"
#include "drivers/recordings/recording_file.h"
#include "tests/daemon/http_client.h"
#include "tests/support/free_port.h"
#include "tests/support/process.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/two_clock_machine.h"

namespace servotwin::daemon {
namespace {

using test::kPatience_s;
using test::TwoClockMachine;
using testing::HasSubstr;

constexpr std::uint32_t kDomain = 92;

/// The values of `name` in the status of the daemon.
nlohmann::json clocks_at(int port) {
  return ask(static_cast<std::uint16_t>(port), "GET", "/api/v1/status").json()["clocks"];
}

TEST(JoinedMachine, CommandsByDdsAndTheEncoderByCanAreOneMachine) {
  const test::TemporaryDirectory directory;
  const int can_port = test::free_port(), http_port = test::free_port();
  const auto map_file = directory.file("map.toml", TwoClockMachine::map_with("0.001"));
  const std::string machine = "joined-" + std::to_string(getpid());
  const auto config = directory.file(
      "m.toml",
      "[machine]\nname = \"" + machine +
          "\"\ncycle_s = 0.001\n[[axis]]\nname = \"X\"\nsource = \"dds\"\nencoder = \"udp\"\n"
          "[dds]\ndomain = " +
          std::to_string(kDomain) +
          "\n[source.udp]\nmap = \"map.toml\"\nlisten = \"127.0.0.1:" + std::to_string(can_port) +
          "\"\n[store]\ndirectory = \"" + (directory.path() / "store").string() +
          "\"\n[http]\nlisten = \"127.0.0.1:" + std::to_string(http_port) + "\"\n");
  test::Process daemon({test::built("servotwind"), "--config", config.string()});
  ASSERT_TRUE(daemon.says("udp is joined to them")) << daemon.said();

  DdsPlace place;
  place.domain = kDomain;
  place.machine = machine;
  const DdsNode node(place);
  constexpr double kDrift = 200e-6;  // far from what a busy host's jitter looks like
  TwoClockMachine sender(node, load_can_map(map_file, Mapped::kChannels),
                         "udp:127.0.0.1:" + std::to_string(can_port), kDrift);
  ASSERT_TRUE(sender.wait_for_daemon(kPatience_s));
  sender.run(12.0);
  const nlohmann::json clocks = clocks_at(http_port);
  ASSERT_TRUE(clocks["known"]) << clocks.dump();
  EXPECT_NEAR(clocks["drift_ppm"], -1e6 * kDrift, 40.0);
  EXPECT_EQ(daemon.end(SIGTERM), 0) << daemon.said();
  EXPECT_THAT(daemon.said(), HasSubstr("the clock of udp has another zero than that of dds; what"));

  // The encoder stands where the command is, but for the time that the clocks are not known.
  std::vector<double> errors;
  std::size_t rows = 0;
  for (const auto& file :
       std::filesystem::directory_iterator(directory.path() / "store/recordings" / machine)) {
    const Recording recording = read_recording(file.path());
    rows += recording.time.size();
    for (std::size_t i = 0; i < recording.time.size(); ++i) {
      const double error = recording.axes[0].actual[i] - recording.axes[0].command[i];
      if (std::isfinite(error)) errors.push_back(std::abs(error));
    }
  }
  EXPECT_GT(rows, 10'000U);
  ASSERT_GT(errors.size(), 4'000U);
  std::nth_element(errors.begin(), errors.begin() + std::ssize(errors) / 2, errors.end());
  // 0.1 ms at 0.2 m/s, and what a busy host held the packets up; without the clocks they would be
  // some 300 um apart in the end.
  EXPECT_LT(errors[errors.size() / 2], 20e-6 + 0.2 * sender.encoder_late_s());
}

}  // namespace
}  // namespace servotwin::daemon
