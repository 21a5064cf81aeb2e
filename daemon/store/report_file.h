// The report of the last diagnosis of an axis (diagnosis/report/report.h), in a file beside the
// database: reports/<machine>/<axis>.html. The old report stays until the new one is complete. Any
// thread. Errors: std::runtime_error if it cannot be written.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace servotwin::daemon {

void write_report(const std::filesystem::path& store, const std::string& machine,
                  const std::string& axis, const std::string& html);
/// The report as HTML; nothing if there is none.
[[nodiscard]] std::optional<std::string> read_report(const std::filesystem::path& store,
                                                     const std::string& machine,
                                                     const std::string& axis);

}  // namespace servotwin::daemon
