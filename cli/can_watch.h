// servotwin watch --can: what a machine says on its buses, how well it says it, and what of its
// errors models predict.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace servotwin::cli {

struct CanWatchOptions {
  std::vector<std::string> interfaces;
  std::filesystem::path map;
  std::vector<std::filesystem::path> models;  ///< of axes whose error is to be predicted
  double seconds = 0.0;                       ///< 0: until it is interrupted
};

void watch_can(const CanWatchOptions& options);

}  // namespace servotwin::cli
