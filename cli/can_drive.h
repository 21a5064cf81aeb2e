// servotwin simulate --can: models as the drives of a bus.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace servotwin::cli {

struct CanDriveOptions {
  std::vector<std::filesystem::path> models;
  std::vector<std::string> interfaces;
  std::filesystem::path map;
  double seconds = 0.0;  ///< 0: until it is interrupted
};

void drive_on_can(const CanDriveOptions& options);

}  // namespace servotwin::cli
