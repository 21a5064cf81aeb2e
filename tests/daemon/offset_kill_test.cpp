#include "tests/daemon/offset_kill.h"
#include "tests/support/free_port.h"

#include "drivers/can/can_udp.h"

namespace servotwin::daemon {
namespace {

using test::OffsetKill;

/// A port that is free now.
class UdpOffsetKill : public OffsetKill {
 protected:
  UdpOffsetKill() {
    const std::string place = "127.0.0.1:" + std::to_string(test::free_port());
    auto bus = std::make_unique<CanUdp>(CanUdpPlace{"127.0.0.1:0", place});
    const std::string ours = "127.0.0.1:" + std::to_string(bus->port());
    source_ =
        "[source.udp]\nmap = \"map.toml\"\nlisten = \"" + place + "\"\npeer = \"" + ours + "\"";
    udp_ = std::move(bus);
  }
  void end_it(int signal) {
    end_it_and_watch_the_drive(std::move(udp_), source_, kCycle_s, signal);
  }

  static constexpr double kCycle_s = 0.001;
  std::string source_;
  std::unique_ptr<CanBus> udp_;
};

TEST_F(UdpOffsetKill, ADriveRampsOutWhatADaemonThatWasKilledHasLeft) { end_it(SIGKILL); }

TEST_F(UdpOffsetKill, ADriveFeelsNoJumpAndNothingStaleWhenTheDaemonStoodStill) {
  pause_it_and_watch_the_drive(std::move(udp_), source_, kCycle_s, {0.008, 0.06, 0.1});
}

TEST_F(UdpOffsetKill, IsNotArmedWhereTheMappingDoesNotSayWhatTheDriveDoes) {
  expect_not_armed(std::move(udp_), source_, kCycle_s, "",
                   "the CAN mapping does not say what the drive of axis X does");
}

TEST_F(UdpOffsetKill, IsNotArmedWhereTheDriveKeepsAnOffset) {
  expect_not_armed(std::move(udp_), source_, kCycle_s, "offset_timeout_s = \"none\"",
                   "the drive of axis X keeps the last offset for ever");
}

TEST_F(UdpOffsetKill, ADaemonThatIsStoppedFadesItsOffsetOutFirst) { end_it(SIGTERM); }

}  // namespace
}  // namespace servotwin::daemon
