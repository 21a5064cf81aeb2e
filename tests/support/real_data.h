// Recordings of real machines. They are not part of the repository: they are found under
// $SERVOTWIN_DATA, or beside the repository in shared/data. Where CI=true a missing one is a
// failure; elsewhere the test reports that the data are missing and counts as skipped, never as
// passed.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string_view>

namespace servotwin::test {

inline std::filesystem::path real_data_directory() {
  if (const char* given = std::getenv("SERVOTWIN_DATA")) return given;
  return std::filesystem::path(SERVOTWIN_SOURCE_DIR).parent_path() / "shared" / "data";
}

inline bool must_have_real_data() {
  const char* ci = std::getenv("CI");
  return ci != nullptr && std::string_view(ci) == "true";
}

}  // namespace servotwin::test

/// Defines `name` as the path of a real recording, or ends the test because it is not there.
/// A macro, because only the test's own function can return from the test.
// NOLINTBEGIN(bugprone-macro-parentheses): `name` is declared here.
#define SERVOTWIN_REAL_DATA(name, relative)                                                   \
  const std::filesystem::path name = servotwin::test::real_data_directory() / (relative);     \
  if (!std::filesystem::exists(name)) {                                                       \
    if (servotwin::test::must_have_real_data()) FAIL() << name << " is not there";            \
    GTEST_SKIP() << name << " is not there: set SERVOTWIN_DATA to the directory that has it"; \
  }
// NOLINTEND(bugprone-macro-parentheses)
