// servotwin simulate --can, --udp: models answer on CAN buses as the drives of a machine.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "drivers/can/can_udp.h"

namespace servotwin::cli {

struct CanDriveOptions {
  std::vector<std::filesystem::path> models;
  std::vector<std::string> interfaces;
  CanUdpPlace udp;  ///< used in place of the interfaces if it has a peer
  std::filesystem::path map;
  double seconds = 0.0;  ///< 0: until interrupted (SIGINT, SIGTERM)
};

void drive_on_can(const CanDriveOptions& options);

}  // namespace servotwin::cli
