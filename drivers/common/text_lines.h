// The lines of a text file, one after the other, through a block of a megabyte.
//
// UTF-8 with or without a byte order mark; UTF-16 with one is decoded. Line ends: LF or CRLF.
// Errors: std::runtime_error with file, line and reason. One thread.
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

#include "drivers/common/file_handle.h"

namespace servotwin {

/// The longest line, too: a longer one is no table.
inline constexpr std::size_t kMaxLineBytes = 1 << 20;

class TextLines {
 public:
  explicit TextLines(const std::filesystem::path& file);

  /// The next line without its end, valid until the next call; false at the end of the file.
  bool next(std::string_view& line);
  /// The last line is returned once more by next().
  void put_back();

  [[nodiscard]] std::size_t number() const { return number_; }
  /// False for a last line that has no line end.
  [[nodiscard]] bool complete() const { return complete_; }
  [[noreturn]] void fail(const std::string& what) const;

 private:
  enum class Encoding { kUtf8, kUtf16Little, kUtf16Big };

  void refill();
  /// Reads bytes behind end_; false at the end of the file.
  bool read_more();
  bool read_utf16();
  void append_utf8(char32_t code);

  std::string source_;
  FileHandle file_;
  std::string block_;
  Encoding encoding_ = Encoding::kUtf8;
  std::string raw_;        // of UTF-16: bytes that are not decoded yet
  std::size_t begin_ = 0;  // of the lines not yet returned
  std::size_t last_ = 0;   // of the line that was returned last
  std::size_t end_ = 0;
  std::size_t number_ = 0;
  bool ended_ = false;
  bool complete_ = true;
};

}  // namespace servotwin
