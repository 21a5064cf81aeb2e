// The messages of the live stream (server-sent events). The newest kMessagesKept are kept for new
// readers and for slow readers; the stream of a reader that falls further behind is ended.
//
// One thread; errors: none.
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <string>
#include <string_view>

namespace servotwin::daemon {

class EventStream {
 public:
  /// Number of messages kept: nineteen seconds of twenty batches and one status per second.
  static constexpr std::size_t kMessagesKept = 400;
  /// How much of the past a new reader gets.
  static constexpr std::int64_t kPast_ns = 10'000'000'000;

  /// Adds a message. `data`: one line. `now_ns`: steady clock, here and below.
  void add(std::string_view event, std::string_view data, std::int64_t now_ns);

  /// Number of the first message for a new reader.
  [[nodiscard]] std::uint64_t start(std::int64_t now_ns) const noexcept {
    const auto first = std::find_if(messages_.begin(), messages_.end(), [&](const Message& one) {
      return now_ns - one.added_ns <= kPast_ns;
    });
    return first_ + static_cast<std::uint64_t>(first - messages_.begin());
  }
  /// Number that the next message will have.
  [[nodiscard]] std::uint64_t end() const noexcept { return first_ + messages_.size(); }
  /// The message; null if it is not kept any more. `number` must be below end().
  [[nodiscard]] const std::string* at(std::uint64_t number) const noexcept {
    return number < first_ ? nullptr : &messages_[static_cast<std::size_t>(number - first_)].text;
  }

 private:
  struct Message {
    std::int64_t added_ns;
    std::string text;
  };
  std::uint64_t first_ = 0;
  std::deque<Message> messages_;
};

}  // namespace servotwin::daemon
