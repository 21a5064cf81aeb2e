// Reads a CAN log as a recording by a mapping: one row per cycle, as the daemon would have received
// it (drivers/can/can_assembly.h). Errors: as drivers/recordings/recording_file.h. Any thread.
#pragma once

#include <filesystem>
#include <optional>

#include "drivers/recordings/can_log/can_log_form.h"
#include "drivers/recordings/recording_file.h"
#include "twin/sample.h"

namespace servotwin {

/// The form of log that options.format names; nothing if it names none.
[[nodiscard]] std::optional<CanLogForm> named_can_log(const ReadOptions& options) noexcept;

/// The mapping is options.can_map.
[[nodiscard]] Recording read_candump(const std::filesystem::path& file, const ReadOptions& options);

}  // namespace servotwin
