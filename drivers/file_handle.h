// An open file of the operating system: closed when it goes out of scope, errors with the file's
// name. Errors: std::runtime_error. One thread at a time.
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
  /// The same under another name in messages.
  [[nodiscard]] static FileHandle open(const std::filesystem::path& file, int flags,
                                       const std::filesystem::path& shown);
  FileHandle(FileHandle&& other) noexcept;
  FileHandle& operator=(FileHandle&&) = delete;
  ~FileHandle();

  /// The number of bytes that came; 0 at the end of the file.
  [[nodiscard]] std::size_t read(char* to, std::size_t size) const;
  [[nodiscard]] std::size_t read_at(char* to, std::size_t size, std::uint64_t offset) const;
  void write(std::string_view bytes) const;
  /// Returns when the bytes are on the disk.
  void flush() const;
  /// Before the end of its life, to hear what a network file system only says then.
  void close();

 private:
  FileHandle(std::filesystem::path shown, int descriptor);
  std::filesystem::path shown_;
  int descriptor_ = -1;
};

/// A small file as a whole; throws if it has more than `most` bytes.
[[nodiscard]] std::string read_text(const std::filesystem::path& file,
                                    std::size_t most = std::size_t{64} << 20);

/// A file that appears whole or not at all: written beside its place, flushed, renamed by commit().
/// What is there and no regular file, as a device or a pipe, is written to and stays what it is.
class AtomicFile {
 public:
  explicit AtomicFile(std::filesystem::path file);
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;
  /// Leaves nothing behind if commit() was not reached.
  ~AtomicFile();

  void write(std::string_view bytes) const { handle_.write(bytes); }
  void commit();

 private:
  std::filesystem::path file_;
  std::filesystem::path beside_;  // file_ itself where that is no regular file
  FileHandle handle_;
  bool committed_ = false;
};

}  // namespace servotwin
