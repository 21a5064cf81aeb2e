// servotwin watch --can: prints, every second, the positions and tracking errors of a machine on
// its CAN buses, incomplete cycles, and the residuals of models.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace servotwin::cli {

struct CanWatchOptions {
  std::vector<std::string> interfaces;
  std::filesystem::path map;
  std::vector<std::filesystem::path> models;  ///< of the axes whose error is predicted
  double seconds = 0.0;                       ///< 0: until interrupted (SIGINT, SIGTERM)
};

void watch_can(const CanWatchOptions& options);

}  // namespace servotwin::cli
