// Sends entries with fields to the journal of systemd, so that `journalctl AXIS=X
// EVENT=model_promoted` finds them. Used if standard error is connected to the journal.
//
// One datagram per entry (systemd's Native Journal Protocol). Any thread. send() does not throw and
// does not wait; it returns false if the journal does not accept the entry.
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace servotwin::daemon {

/// Priorities of syslog.
enum class Priority { kError = 3, kWarning = 4, kNotice = 5, kInfo = 6 };

class Journal {
 public:
  using Fields = std::vector<std::pair<std::string_view, std::string_view>>;

  /// `socket`: path of the socket on which the journal listens.
  explicit Journal(const std::string& socket = "/run/systemd/journal/socket");
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;
  ~Journal();

  /// True if file descriptor `file` is the stream that the service manager connected to the journal
  /// ($JOURNAL_STREAM).
  [[nodiscard]] static bool is_behind(int file);

  /// False if the journal did not accept the entry. Fields without a value are left out.
  bool send(Priority priority, std::string_view message, const Fields& fields = {}) const noexcept;

 private:
  std::string path_;
  int socket_ = -1;
};

}  // namespace servotwin::daemon
