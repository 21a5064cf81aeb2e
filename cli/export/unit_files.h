// The files that every unit contains, embedded in the program: the C sources of cli/export/sources,
// the shared library built from them, and the licence. Any thread.
#pragma once

#include <span>
#include <string_view>

namespace servotwin {

struct UnitFile {
  std::string_view name;  ///< "fmu.c"; the shared library is kUnitLibrary, the licence kUnitLicence
  std::string_view content;
};

inline constexpr std::string_view kUnitLibrary = "library", kUnitLicence = "licence";

[[nodiscard]] std::span<const UnitFile> unit_files() noexcept;

}  // namespace servotwin
