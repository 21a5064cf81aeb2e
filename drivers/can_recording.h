// Reads a CAN log as a recording by a mapping: one row per cycle, as the daemon would have received
// it (drivers/can_assembly.h). Errors: as drivers/recording_file.h. Any thread.
#pragma once

#include <filesystem>

#include "drivers/recording_file.h"
#include "twin/sample.h"

namespace servotwin {

/// The mapping is options.can_map.
[[nodiscard]] Recording read_candump(const std::filesystem::path& file, const ReadOptions& options);

}  // namespace servotwin
