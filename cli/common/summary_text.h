// The live record of a machine for people, on one screen, and for programs (servotwin.watch/1).
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "cli/common/live_record.h"

namespace servotwin::cli {

/// `where`: machine and domain; `seconds`: how long was watched, here and below.
[[nodiscard]] std::vector<std::string> summary_lines(const LiveRecord& record,
                                                     const std::string& where);
[[nodiscard]] nlohmann::json summary_json(const LiveRecord& record, const std::string& machine,
                                          double seconds);

/// The last second on one line, and as JSON.
[[nodiscard]] std::string line_of(const LiveRecord& record, double seconds);
[[nodiscard]] nlohmann::json line_json(const LiveRecord& record, const std::string& machine,
                                       double seconds);
/// The last second as a table for a screen that is written over.
[[nodiscard]] std::vector<std::string> screen_lines(const LiveRecord& record,
                                                    const std::string& where, double seconds);

}  // namespace servotwin::cli
