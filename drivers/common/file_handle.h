// An open file of the operating system, closed when it goes out of scope. Errors:
// std::runtime_error with the name of the file. One thread at a time.
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace servotwin {

class FileHandle {
 public:
  /// `flags` as for open(2).
  [[nodiscard]] static FileHandle open(const std::filesystem::path& file, int flags);
  /// The same, with the name `shown` in error messages.
  [[nodiscard]] static FileHandle open(const std::filesystem::path& file, int flags,
                                       const std::filesystem::path& shown);
  FileHandle(FileHandle&& other) noexcept;
  FileHandle& operator=(FileHandle&&) = delete;
  ~FileHandle();

  /// Returns the number of bytes read; 0 at the end of the file.
  [[nodiscard]] std::size_t read(char* to, std::size_t size) const;
  [[nodiscard]] std::size_t read_at(char* to, std::size_t size, std::uint64_t offset) const;
  void write(std::string_view bytes) const;
  /// Returns when the bytes are on the disk.
  void flush() const;
  /// Closes the file before destruction, because a network file system may report a write error
  /// only then.
  void close();

 private:
  FileHandle(std::filesystem::path shown, int descriptor);
  std::filesystem::path shown_;
  int descriptor_ = -1;
};

/// A small file as a whole; throws if it has more than `most` bytes.
[[nodiscard]] std::string read_text(const std::filesystem::path& file,
                                    std::size_t most = std::size_t{64} << 20);

/// A file that is written completely or not at all: under a temporary name, then flushed and
/// renamed by commit(). An existing file that is not a regular one, such as a device or a pipe, is
/// written to directly.
class AtomicFile {
 public:
  explicit AtomicFile(std::filesystem::path file);
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;
  /// Removes the temporary file if commit() was not called.
  ~AtomicFile();

  void write(std::string_view bytes) const { handle_.write(bytes); }
  /// Where the bytes are until commit(), for a check of them.
  [[nodiscard]] const std::filesystem::path& temporary() const noexcept { return beside_; }
  void commit();

 private:
  std::filesystem::path file_;
  std::filesystem::path beside_;  // temporary file; file_ itself if that is not a regular file
  FileHandle handle_;
  bool committed_ = false;
};

}  // namespace servotwin
