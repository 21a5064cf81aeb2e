// The event log: every event is one line on standard error (or in the journal), and a row in the
// store.
//
// An event that cannot be stored is printed nevertheless, together with the reason. Any thread
// except the real-time loop. Errors: none.
#pragma once

#include <condition_variable>
#include <deque>
#include <mutex>
#include <ostream>
#include <stop_token>
#include <string>
#include <thread>
#include <utility>

#include "daemon/store/journal.h"
#include "daemon/store/store.h"

namespace servotwin::daemon {

class EventLog {
 public:
  /// Both must outlive the log.
  EventLog(Store& store, std::ostream& out) : store_(store), out_(out) {}
  /// With a journal, lines go there instead of `out`, with the fields MACHINE, AXIS, EVENT and
  /// DETAIL. It must outlive the log.
  EventLog(Store& store, std::ostream& out, const Journal* journal, std::string machine)
      : store_(store), out_(out), journal_(journal), machine_(std::move(machine)) {}

  /// Logs an event. `axis` empty: of the machine. `detail`: JSON, or empty.
  void note(const std::string& kind, const std::string& axis, const std::string& text,
            const std::string& detail = "");
  /// The same, but it is stored in a thread of the log: for threads that must not wait for the
  /// disk.
  void note_soon(const std::string& kind, const std::string& axis, const std::string& text);
  /// Logs an error that needs attention; the status shows the last one with its time.
  void error(const std::string& kind, const std::string& axis, const std::string& text);
  /// Prints an event that has been stored already.
  void print(const Event& event);
  /// Sets `text` to the last error, unless another thread is just writing it.
  void update_last_error(std::string& text) const;

 private:
  void add(const Event& event, Priority priority);
  void print(const Event& event, Priority priority);
  void store(const Event& event);
  void store_waiting(const std::stop_token& stop);

  /// More do not wait for a hung disk: they are printed only.
  static constexpr std::size_t kMaxWaiting = 1000;

  Store& store_;
  std::ostream& out_;
  const Journal* journal_ = nullptr;
  std::string machine_;
  mutable std::mutex mutex_;
  std::string last_error_;
  std::mutex waiting_mutex_;
  std::condition_variable_any waiting_changed_;
  std::deque<Event> waiting_;
  std::jthread storing_;  // declared last: it uses the members above
};

/// An event that happens now.
[[nodiscard]] Event event_now(const std::string& kind, const std::string& axis,
                              const std::string& text, const std::string& detail = "");

}  // namespace servotwin::daemon
