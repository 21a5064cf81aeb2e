#include "daemon/event_log.h"

#include <stdexcept>

#include "daemon/clock.h"

namespace servotwin {

Event event_now(const std::string& kind, const std::string& axis, const std::string& text,
                const std::string& detail) {
  return {iso_time(wall_ns()), axis, kind, text, detail};
}

void EventLog::note(const std::string& kind, const std::string& axis, const std::string& text,
                    const std::string& detail) {
  const Event event = event_now(kind, axis, text, detail);
  print(event);
  try {
    store_.add(event);
  } catch (const std::runtime_error& failure) {
    const std::lock_guard lock(mutex_);
    last_error_ = failure.what();
    out_ << "servotwind: this event is not stored: " << failure.what() << std::endl;
  }
}

void EventLog::error(const std::string& kind, const std::string& axis, const std::string& text) {
  {
    const std::lock_guard lock(mutex_);
    last_error_ = axis.empty() ? text : axis + ": " + text;
  }
  note(kind, axis, text);
}

void EventLog::print(const Event& event) {
  const std::lock_guard lock(mutex_);
  out_ << "servotwind: " << (event.axis.empty() ? "" : event.axis + ": ") << event.text
       << std::endl;
}

void EventLog::update_last_error(std::string& text) const {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (lock.owns_lock()) text = last_error_;
}

}  // namespace servotwin
