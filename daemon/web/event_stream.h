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

namespace servotwin {

class EventStream {
 public:
  /// Nineteen seconds of twenty batches and a status per second.
  static constexpr std::size_t kKept = 400;
  /// What a new reader gets of the past: ten seconds.
  static constexpr std::size_t kPast = 210;

  /// `json` is one line.
  void add(std::string_view event, std::string_view json);

  /// The number of the first message for a new reader.
  [[nodiscard]] std::uint64_t start() const noexcept {
    return end() - std::min<std::uint64_t>(kPast, messages_.size());
  }
  /// The number that the next message will have.
  [[nodiscard]] std::uint64_t end() const noexcept { return first_ + messages_.size(); }
  /// Null if it is not kept any more; `number` below end().
  [[nodiscard]] const std::string* at(std::uint64_t number) const noexcept {
    return number < first_ ? nullptr : &messages_[static_cast<std::size_t>(number - first_)];
  }

 private:
  std::uint64_t first_ = 0;
  std::deque<std::string> messages_;
};

}  // namespace servotwin
