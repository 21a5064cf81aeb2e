// Reads texts as tables, for tests.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <string_view>

#include "drivers/recordings/recording_file.h"
#include "tests/support/temporary_directory.h"

namespace servotwin {

class TableFixture : public testing::Test {
 protected:
  [[nodiscard]] Recording read(std::string_view text, const ReadOptions& options = {}) const {
    return read_recording(directory_.file("table.csv", text), options);
  }
  static ReadOptions mapped(const char* columns) {
    ReadOptions options;
    options.columns = columns;
    return options;
  }
  /// All notes, a line each.
  static std::string notes(const Recording& recording) {
    std::string all;
    for (const std::string& note : recording.notes) all += note + "\n";
    return all;
  }

  test::TemporaryDirectory directory_;
};

}  // namespace servotwin
