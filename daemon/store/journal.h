// The journal of systemd, where standard error goes to it: entries with fields instead of bare
// lines, so that `journalctl AXIS=X EVENT=model_promoted` finds them.
//
// One datagram per entry (systemd's Native Journal Protocol). Any thread; nothing is thrown and
// nothing waits: what the journal does not take is the caller's to say otherwise.
#pragma once

#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace servotwin::daemon {

/// Of syslog.
enum class Priority { kError = 3, kWarning = 4, kNotice = 5, kInfo = 6 };

class Journal {
 public:
  using Fields = std::vector<std::pair<std::string_view, std::string_view>>;

  /// `socket`: where a journal listens.
  explicit Journal(const std::string& socket = "/run/systemd/journal/socket");
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;
  ~Journal();

  /// True if file descriptor `file` is the stream that the service manager connected to the journal
  /// ($JOURNAL_STREAM).
  [[nodiscard]] static bool is_behind(int file);

  /// False if the journal did not take it. Fields without a value are left out.
  bool send(Priority priority, std::string_view message, const Fields& fields = {}) const noexcept;

 private:
  std::string path_;
  int socket_ = -1;
};

}  // namespace servotwin::daemon
