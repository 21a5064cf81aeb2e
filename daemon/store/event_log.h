// What happened, one line each: on standard error at once, and in the store.
//
// A line that cannot be stored is printed all the same, with why. Any thread but the real-time
// loop.
#pragma once

#include <mutex>
#include <ostream>
#include <string>
#include <utility>

#include "daemon/store/journal.h"
#include "daemon/store/store.h"

namespace servotwin::daemon {

class EventLog {
 public:
  /// Both outlive the log.
  EventLog(Store& store, std::ostream& out) : store_(store), out_(out) {}
  /// With a journal, lines go there instead, with fields: MACHINE, AXIS, EVENT, DETAIL. It outlives
  /// the log, too.
  EventLog(Store& store, std::ostream& out, const Journal* journal, std::string machine)
      : store_(store), out_(out), journal_(journal), machine_(std::move(machine)) {}

  void note(const std::string& kind, const std::string& axis, const std::string& text,
            const std::string& detail = "");
  /// The same for what somebody should look after; the status shows the last one with its time.
  void error(const std::string& kind, const std::string& axis, const std::string& text);
  /// Prints an event that is in the store already.
  void print(const Event& event);
  /// Brings `text` up to date with the last error, unless somebody is writing just now.
  void update_last_error(std::string& text) const;

 private:
  void add(const Event& event, Priority priority);
  void print(const Event& event, Priority priority);

  Store& store_;
  std::ostream& out_;
  const Journal* journal_ = nullptr;
  std::string machine_;
  mutable std::mutex mutex_;
  std::string last_error_;
};

/// An event that happens now.
[[nodiscard]] Event event_now(const std::string& kind, const std::string& axis,
                              const std::string& text, const std::string& detail = "");

}  // namespace servotwin::daemon
