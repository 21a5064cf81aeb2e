#include "tests/daemon/offset_kill.h"

#include "drivers/can_udp.h"

namespace servotwin::daemon {
namespace {

using test::OffsetKill;

/// A port that is free now.
int free_port() { return CanUdp({"127.0.0.1:0", ""}).port(); }

class UdpOffsetKill : public OffsetKill {
 protected:
  void end_it(int signal) {
    const std::string place = "127.0.0.1:" + std::to_string(free_port());
    auto bus = std::make_unique<CanUdp>(CanUdpPlace{"127.0.0.1:0", place});
    const std::string ours = "127.0.0.1:" + std::to_string(bus->port());
    end_it_and_watch_the_drive(
        std::move(bus),
        "[source.udp]\nmap = \"map.toml\"\nlisten = \"" + place + "\"\npeer = \"" + ours + "\"",
        0.001, signal);
  }
};

TEST_F(UdpOffsetKill, ADriveRampsOutWhatADaemonThatWasKilledHasLeft) { end_it(SIGKILL); }

TEST_F(UdpOffsetKill, ADaemonThatIsStoppedFadesItsOffsetOutFirst) { end_it(SIGTERM); }

}  // namespace
}  // namespace servotwin::daemon
