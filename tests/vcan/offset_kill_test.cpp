#include "tests/daemon/offset_kill.h"

#include "drivers/can/socketcan.h"

namespace servotwin {
namespace {

using test::OffsetKill;

TEST_F(OffsetKill, ADriveRampsOutWhatADaemonThatWasKilledHasLeft) {
  end_it_and_watch_the_drive(std::make_unique<SocketCan>("vcan0"),
                             "[source.can]\nmap = \"map.toml\"\ninterfaces = [\"vcan0\"]", 0.01,
                             SIGKILL);
}

}  // namespace
}  // namespace servotwin
