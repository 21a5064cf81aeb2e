#include "daemon/store/journal.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>

namespace servotwin::daemon {
namespace {

// Longer fields are truncated in the journal; the store has all of them.
constexpr std::size_t kMaxFieldBytes = 32 * 1024;

/// Appends NAME=value, or for a value with several lines: NAME, its length in 64 bits, the value.
void append(std::string& entry, std::string_view name, std::string_view value) {
  value = value.substr(0, kMaxFieldBytes);
  entry += name;
  if (value.find('\n') == value.npos) {
    entry += '=';
  } else {
    entry += '\n';
    for (std::uint64_t length = value.size(), byte = 0; byte < 8; ++byte)
      entry += static_cast<char>(length >> (8 * byte) & 0xFF);
  }
  entry += value;
  entry += '\n';
}

}  // namespace

Journal::Journal(const std::string& socket)
    : path_(socket), socket_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)) {}

Journal::~Journal() {
  if (socket_ >= 0) close(socket_);
}

bool Journal::is_behind(int file) {
  const char* stream = std::getenv("JOURNAL_STREAM");  // "device:inode"
  struct stat status {};
  if (stream == nullptr || fstat(file, &status) != 0) return false;
  return stream == std::to_string(status.st_dev) + ":" + std::to_string(status.st_ino);
}

bool Journal::send(Priority priority, std::string_view message,
                   const Fields& fields) const noexcept {
  try {
    std::string entry;
    append(entry, "PRIORITY", std::to_string(static_cast<int>(priority)));
    append(entry, "SYSLOG_IDENTIFIER", "servotwind");
    append(entry, "MESSAGE", message);
    for (const auto& [name, value] : fields) {
      if (!value.empty()) append(entry, name, value);
    }
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    if (path_.size() >= sizeof address.sun_path) return false;
    std::memcpy(address.sun_path, path_.c_str(), path_.size());
    return sendto(socket_, entry.data(), entry.size(), MSG_NOSIGNAL,
                  reinterpret_cast<const sockaddr*>(&address),
                  sizeof address) == static_cast<ssize_t>(entry.size());
  } catch (const std::bad_alloc&) {
    return false;
  }
}

}  // namespace servotwin::daemon
