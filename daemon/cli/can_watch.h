// servotwin watch --can: what a machine says on its buses, and how well it says it.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace servotwin::cli {

struct CanWatchOptions {
  std::vector<std::string> interfaces;
  std::filesystem::path map;
  double seconds = 0.0;  ///< 0: until it is interrupted
};

void watch_can(const CanWatchOptions& options);

}  // namespace servotwin::cli
