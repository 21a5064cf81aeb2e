// CAN logs as text, in the format of `candump -l`, `candump -L`, python-can and canplayer.
//
//   (1436509052.249713) can0 181#E803000012000000     data, 11 bits of id; 8 digits: 29 bits
//   (1436509052.249713) can0 181#R4                   remote request for four bytes
//   (1436509052.249713) can0 181##1E8030000           FD: one digit of flags before the data
//   (1436509052.249713) can0 20000040#0000000000000000   an error frame of the interface
// A direction at the end of a line (R, T) is ignored. Source: can-utils, lib.c. Any thread.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "drivers/can_frame.h"
#include "drivers/file_handle.h"

namespace servotwin {

struct CandumpLine {
  CanFrame frame;
  std::string interface;
};

/// Parses one line without its line end. Throws std::runtime_error with column, value and rule.
[[nodiscard]] CandumpLine parse_candump_line(std::string_view line);

/// The line of a frame, without a line end.
[[nodiscard]] std::string candump_line(const CanFrame& frame, std::string_view interface);

/// Whether a file with this beginning is such a log.
[[nodiscard]] bool is_candump(std::string_view beginning);

/// The same for a file; false if it cannot be read.
[[nodiscard]] bool is_can_log(const std::filesystem::path& file);

/// Reads a log line by line. Empty lines and lines that begin with # are ignored.
class CandumpReader {
 public:
  explicit CandumpReader(const std::filesystem::path& file);
  /// Returns false at the end of the file. Throws std::runtime_error with file and line for an
  /// invalid line; a last line without a line end is dropped and reported in notes().
  bool next(CandumpLine& line);
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }

 private:
  bool next_text(std::string_view& text);

  std::string name_;
  FileHandle file_;
  std::string block_;
  std::size_t begin_ = 0;  // of what is not read yet, in block_
  std::size_t line_ = 0;
  bool at_end_ = false;
  bool whole_ = true;  // the line that was read had its end
  std::vector<std::string> notes_;
};

}  // namespace servotwin
