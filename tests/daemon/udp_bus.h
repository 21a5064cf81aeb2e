// A bus of CAN over UDP on this host, with the section of the daemon's configuration for it.
#pragma once

#include <memory>
#include <string>

#include "drivers/can/can_udp.h"
#include "tests/support/free_port.h"

namespace servotwin::test {

struct UdpBus {
  UdpBus() {
    const std::string place = "127.0.0.1:" + std::to_string(free_port());
    auto udp = std::make_unique<CanUdp>(CanUdpPlace{"127.0.0.1:0", place});
    source = "[source.udp]\nmap = \"map.toml\"\nlisten = \"" + place +
             "\"\npeer = \"127.0.0.1:" + std::to_string(udp->port()) + "\"";
    bus = std::move(udp);
  }

  std::unique_ptr<CanBus> bus;
  std::string source;
};

}  // namespace servotwin::test
