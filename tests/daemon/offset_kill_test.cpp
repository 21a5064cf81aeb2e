#include "tests/daemon/offset_kill.h"

#include "drivers/can_udp.h"

namespace servotwin::daemon {
namespace {

using test::OffsetKill;

/// A port that is free now.
int free_port() { return CanUdp({"127.0.0.1:0", ""}).port(); }

TEST_F(OffsetKill, ADriveRampsOutWhatADaemonThatWasKilledHasLeft) {
  const std::string place = "127.0.0.1:" + std::to_string(free_port());
  auto bus = std::make_unique<CanUdp>(CanUdpPlace{"127.0.0.1:0", place});
  const std::string ours = "127.0.0.1:" + std::to_string(bus->port());
  kill_it_and_watch_the_drive(
      std::move(bus),
      "[source.udp]\nmap = \"map.toml\"\nlisten = \"" + place + "\"\npeer = \"" + ours + "\"",
      0.001);
}

}  // namespace
}  // namespace servotwin::daemon
