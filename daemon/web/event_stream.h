// The messages of the live stream (server-sent events), the newest of them kept for who comes now
// and for who reads slowly. Who falls further behind than that has lost some: his stream ends.
//
// One thread.
#pragma once

#include <algorithm>
#include <cstdint>
#include <deque>
#include <string>
#include <string_view>

namespace servotwin::daemon {

class EventStream {
 public:
  /// Nineteen seconds of twenty batches and a status per second.
  static constexpr std::size_t kKept = 400;
  /// What a new reader gets of the past.
  static constexpr std::int64_t kPast_ns = 10'000'000'000;

  /// `json` is one line. `now_ns`: steady, here as below.
  void add(std::string_view event, std::string_view json, std::int64_t now_ns);

  /// The number of the first message for a new reader.
  [[nodiscard]] std::uint64_t start(std::int64_t now_ns) const noexcept {
    const auto first = std::find_if(messages_.begin(), messages_.end(), [&](const Message& one) {
      return now_ns - one.added_ns <= kPast_ns;
    });
    return first_ + static_cast<std::uint64_t>(first - messages_.begin());
  }
  /// The number that the next message will have.
  [[nodiscard]] std::uint64_t end() const noexcept { return first_ + messages_.size(); }
  /// Null if it is not kept any more; `number` below end().
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
