// Reads a CAN log line by line: that of candump -l, or of another program (can_log_form.h). Empty
// lines, comments and lines that are no frame are passed over. One thread.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/common/file_handle.h"
#include "drivers/recordings/can_log/can_log_form.h"

namespace servotwin {

/// Whether it is a CAN log; false if it cannot be read.
[[nodiscard]] bool is_can_log(const std::filesystem::path& file);

class CanLogReader {
 public:
  /// `named`: as of CanLogLines. Throws std::runtime_error if the file cannot be opened or read.
  explicit CanLogReader(const std::filesystem::path& file, std::optional<CanLogForm> named = {});
  /// Returns false at the end of the file. Throws std::runtime_error with file and line for an
  /// invalid line; a last line without a line end is dropped and reported in notes().
  bool next(CandumpLine& line);
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }

 private:
  /// Another block behind what is not read yet; all of that.
  std::string_view read_block();
  bool next_text(std::string_view& text);

  std::string name_;
  FileHandle file_;
  std::string block_;
  bool at_end_ = false;
  CanLogLines lines_;      // from the first block
  std::size_t begin_ = 0;  // of what is not read yet, in block_
  std::size_t line_ = 0;
  bool whole_ = true;  // the line that was read had its end
  std::vector<std::string> notes_;
};

}  // namespace servotwin
