// servotwin replay onto a CAN bus: sends the frames of a log unchanged, or a recording encoded into
// the frames of a mapping.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "drivers/recordings/recording_file.h"

namespace servotwin::cli {

struct CanReplayOptions {
  std::filesystem::path file;
  ReadOptions read;                     ///< of a recording; for a log its mapping is not used
  std::vector<std::string> interfaces;  ///< --can
  std::string udp;                      ///< --udp HOST:PORT
  bool targets = false;  ///< send target positions, as the controller, instead of drives' answers
  double speed = 1.0;
};

void replay_onto_can(const CanReplayOptions& options);

}  // namespace servotwin::cli
