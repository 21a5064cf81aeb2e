// servotwin replay onto a CAN bus: the frames of a log as they were, or a recording put into the
// frames of a mapping.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "drivers/recording_file.h"

namespace servotwin::cli {

struct CanReplayOptions {
  std::filesystem::path file;
  ReadOptions read;                     ///< of a recording; its mapping for a log is not used
  std::vector<std::string> interfaces;  ///< --can
  std::string udp;                      ///< --udp HOST:PORT
  bool targets = false;                 ///< as the controller: target positions instead of answers
  double speed = 1.0;
};

void replay_onto_can(const CanReplayOptions& options);

}  // namespace servotwin::cli
