#include "daemon/web/event_stream.h"

namespace servotwin::daemon {

void EventStream::add(std::string_view event, std::string_view data, std::int64_t now_ns) {
  std::string message = "event: ";
  message.append(event).append("\ndata: ").append(data).append("\n\n");
  messages_.push_back({now_ns, std::move(message)});
  if (messages_.size() <= kMessagesKept) return;
  messages_.pop_front();
  ++first_;
}

}  // namespace servotwin::daemon
