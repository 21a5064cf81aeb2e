#include "tests/daemon/offset_kill.h"
#include "tests/daemon/udp_bus.h"

namespace servotwin::daemon {
namespace {

using test::OffsetKill;

class UdpOffsetKill : public OffsetKill {
 protected:
  void end_it(int signal) {
    end_it_and_watch_the_drive(std::move(udp_.bus), udp_.source, kCycle_s, signal);
  }

  static constexpr double kCycle_s = 0.001;
  test::UdpBus udp_;
};

TEST_F(UdpOffsetKill, ADriveRampsOutWhatADaemonThatWasKilledHasLeft) { end_it(SIGKILL); }

TEST_F(UdpOffsetKill, ADriveFeelsNoJumpAndNothingStaleWhenTheDaemonStoodStill) {
  pause_it_and_watch_the_drive(std::move(udp_.bus), udp_.source, kCycle_s, {0.008, 0.06, 0.1});
}

TEST_F(UdpOffsetKill, IsNotArmedWhereTheMappingDoesNotSayWhatTheDriveDoes) {
  expect_not_armed(std::move(udp_.bus), udp_.source, kCycle_s, "",
                   "the CAN mapping does not say what the drive of axis X does");
}

TEST_F(UdpOffsetKill, IsNotArmedWhereTheDriveKeepsAnOffset) {
  expect_not_armed(std::move(udp_.bus), udp_.source, kCycle_s, "offset_timeout_s = \"none\"",
                   "the drive of axis X keeps the last offset for ever");
}

TEST_F(UdpOffsetKill, ADaemonThatIsStoppedFadesItsOffsetOutFirst) { end_it(SIGTERM); }

}  // namespace
}  // namespace servotwin::daemon
