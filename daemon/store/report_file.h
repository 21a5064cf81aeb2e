// The page of an axis' last diagnosis (diagnosis/report.h), in a file beside the store:
// reports/<machine>/<axis>.html. The old one stays until the new one is complete. Any thread.
// Errors: std::runtime_error where it cannot be written.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace servotwin::daemon {

void write_report(const std::filesystem::path& store, const std::string& machine,
                  const std::string& axis, const std::string& html);
/// Nothing if there is none.
[[nodiscard]] std::optional<std::string> read_report(const std::filesystem::path& store,
                                                     const std::string& machine,
                                                     const std::string& axis);

}  // namespace servotwin::daemon
