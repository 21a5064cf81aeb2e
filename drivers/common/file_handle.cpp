#include "drivers/common/file_handle.h"

#include <fcntl.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <stdexcept>
#include <system_error>
#include <utility>

namespace servotwin {
namespace {

[[noreturn]] void fail(const std::filesystem::path& file, const char* what) {
  throw std::runtime_error(file.string() + ": " + what + ": " +
                           std::generic_category().message(errno));
}

std::filesystem::path name_beside(const std::filesystem::path& file) {
  std::error_code unknown;
  if (const auto there = std::filesystem::status(file, unknown);
      std::filesystem::exists(there) && !std::filesystem::is_regular_file(there))
    return file;
  static std::atomic<unsigned> count{0};
  return file.string() + ".part-" + std::to_string(getpid()) + "-" + std::to_string(++count);
}

}  // namespace

FileHandle::FileHandle(std::filesystem::path shown, int descriptor)
    : shown_(std::move(shown)), descriptor_(descriptor) {}

FileHandle::FileHandle(FileHandle&& other) noexcept
    : shown_(std::move(other.shown_)), descriptor_(std::exchange(other.descriptor_, -1)) {}

FileHandle::~FileHandle() {
  if (descriptor_ >= 0) ::close(descriptor_);
}

FileHandle FileHandle::open(const std::filesystem::path& file, int flags) {
  return open(file, flags, file);
}

FileHandle FileHandle::open(const std::filesystem::path& file, int flags,
                            const std::filesystem::path& shown) {
  const int descriptor = ::open(file.c_str(), flags | O_CLOEXEC, 0666);
  if (descriptor < 0)
    fail(shown, (flags & O_CREAT) != 0 ? "cannot be written" : "cannot be opened");
  return {shown, descriptor};
}

std::size_t FileHandle::read(char* to, std::size_t size) const {
  ssize_t count = 0;
  do {
    count = ::read(descriptor_, to, size);
  } while (count < 0 && errno == EINTR);
  if (count < 0) fail(shown_, "cannot be read");
  return static_cast<std::size_t>(count);
}

std::size_t FileHandle::read_at(char* to, std::size_t size, std::uint64_t offset) const {
  ssize_t count = 0;
  do {
    count = ::pread(descriptor_, to, size, static_cast<off_t>(offset));
  } while (count < 0 && errno == EINTR);
  if (count < 0) fail(shown_, "cannot be read");
  return static_cast<std::size_t>(count);
}

void FileHandle::write(std::string_view bytes) const {
  while (!bytes.empty()) {
    const ssize_t count = ::write(descriptor_, bytes.data(), bytes.size());
    if (count < 0 && errno == EINTR) continue;
    if (count < 0) fail(shown_, "cannot be written");
    bytes.remove_prefix(static_cast<std::size_t>(count));
  }
}

void FileHandle::flush() const {
  // On some file systems a directory cannot be flushed, which is reported; no data are lost.
  if (::fsync(descriptor_) != 0 && errno != EINVAL) fail(shown_, "cannot be written");
}

void FileHandle::close() {
  if (::close(std::exchange(descriptor_, -1)) != 0) fail(shown_, "cannot be written");
}

std::string read_text(const std::filesystem::path& file, std::size_t most) {
  const FileHandle handle = FileHandle::open(file, O_RDONLY);
  std::string text;
  char block[4096];
  while (const std::size_t count = handle.read(block, sizeof block)) {
    text.append(block, count);
    if (text.size() > most) {
      throw std::runtime_error(file.string() + ": has more than " + std::to_string(most >> 20) +
                               " MB; this is not the expected kind of file");
    }
  }
  return text;
}

AtomicFile::AtomicFile(std::filesystem::path file)
    : file_(std::move(file)),
      beside_(name_beside(file_)),
      handle_(FileHandle::open(beside_, beside_ == file_ ? O_WRONLY : O_WRONLY | O_CREAT | O_EXCL,
                               file_)) {}

AtomicFile::~AtomicFile() {
  if (!committed_ && beside_ != file_) ::unlink(beside_.c_str());
}

void AtomicFile::commit() {
  handle_.flush();
  handle_.close();
  if (beside_ == file_) {
    committed_ = true;
    return;
  }
  if (::rename(beside_.c_str(), file_.c_str()) != 0) fail(file_, "cannot be written");
  committed_ = true;
  // The directory with the new name must be flushed to the disk, too.
  const auto directory = file_.has_parent_path() ? file_.parent_path() : std::filesystem::path(".");
  FileHandle::open(directory, O_RDONLY | O_DIRECTORY).flush();
}

}  // namespace servotwin
