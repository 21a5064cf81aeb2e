#include "daemon/store/event_log.h"

#include <stdexcept>

#include "daemon/between/clock.h"

namespace servotwin::daemon {
namespace {

/// The syslog priority of events that are not errors.
Priority priority_of(const std::string& kind) {
  for (const char* one :
       {"alarm_raised", "diagnosis_failed", "model_unused", "stalled", "token_refused"}) {
    if (kind == one) return Priority::kWarning;
  }
  for (const char* one :
       {"model_promoted", "diagnosis", "alarm_cleared", "started", "stopped", "reloaded"}) {
    if (kind == one) return Priority::kNotice;
  }
  return Priority::kInfo;
}

}  // namespace

Event event_now(const std::string& kind, const std::string& axis, const std::string& text,
                const std::string& detail) {
  return {iso_time(wall_ns()), axis, kind, text, detail};
}

void EventLog::add(const Event& event, Priority priority) {
  print(event, priority);
  store(event);
}

void EventLog::store(const Event& event) {
  try {
    store_.add(event);
  } catch (const std::runtime_error& failure) {
    const std::string why = std::string("this event could not be stored: ") + failure.what();
    print({event.time, "", "not_stored", why, ""}, Priority::kError);
    const std::lock_guard lock(mutex_);
    last_error_ = event.time + " " + failure.what();
  }
}

void EventLog::note(const std::string& kind, const std::string& axis, const std::string& text,
                    const std::string& detail) {
  const Event event = event_now(kind, axis, text, detail);
  add(event, priority_of(event.kind));
}

void EventLog::note_soon(const std::string& kind, const std::string& axis,
                         const std::string& text) {
  const Event event = event_now(kind, axis, text);
  print(event, priority_of(event.kind));
  const std::lock_guard lock(waiting_mutex_);
  if (waiting_.size() >= kMaxWaiting) return;
  waiting_.push_back(event);
  if (!storing_.joinable())
    storing_ = std::jthread([this](const std::stop_token& stop) { store_waiting(stop); });
  waiting_changed_.notify_one();
}

/// Ends when it is asked to and all are stored.
void EventLog::store_waiting(const std::stop_token& stop) {
  std::unique_lock lock(waiting_mutex_);
  while (waiting_changed_.wait(lock, stop, [&] { return !waiting_.empty(); })) {
    const Event event = std::move(waiting_.front());
    waiting_.pop_front();
    lock.unlock();
    store(event);
    lock.lock();
  }
}

void EventLog::error(const std::string& kind, const std::string& axis, const std::string& text) {
  const Event event = event_now(kind, axis, text);
  {
    const std::lock_guard lock(mutex_);
    last_error_ = event.time + " " + (axis.empty() ? text : axis + ": " + text);
  }
  add(event, Priority::kError);
}

void EventLog::print(const Event& event) { print(event, priority_of(event.kind)); }

void EventLog::print(const Event& event, Priority priority) {
  const std::string line = (event.axis.empty() ? "" : event.axis + ": ") + event.text;
  if (journal_ != nullptr && journal_->send(priority, line,
                                            {{"MACHINE", machine_},
                                             {"AXIS", event.axis},
                                             {"EVENT", event.kind},
                                             {"DETAIL", event.detail}})) {
    return;
  }
  const std::lock_guard lock(mutex_);
  out_ << "servotwind: " << line << std::endl;
}

void EventLog::update_last_error(std::string& text) const {
  const std::unique_lock lock(mutex_, std::try_to_lock);
  if (lock.owns_lock()) text = last_error_;
}

}  // namespace servotwin::daemon
