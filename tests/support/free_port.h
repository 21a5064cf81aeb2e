// A port of this host that nobody uses, for UDP and TCP.
#pragma once

#include "drivers/can/can_udp.h"

namespace servotwin::test {

inline int free_port() { return CanUdp({"127.0.0.1:0", ""}).port(); }

}  // namespace servotwin::test
