#include "daemon/web/token_guesses.h"

#include <algorithm>
#include <utility>

namespace servotwin::daemon {

bool TokenGuesses::must_wait(const std::string& address, std::int64_t now_ns) const {
  const auto found = of_.find(address);
  return found != of_.end() && found->second.count >= kGuessesBeforeHold &&
         now_ns - found->second.last_ns <= kForgotten_ns;
}

std::optional<std::string> TokenGuesses::add(const std::string& address, std::int64_t now_ns) {
  std::erase_if(of_, [&](const auto& one) { return now_ns - one.second.last_ns > kForgotten_ns; });
  if (of_.size() >= kMaxAddresses && !of_.contains(address))
    of_.erase(std::min_element(of_.begin(), of_.end(), [](const auto& a, const auto& b) {
      return a.second.last_ns < b.second.last_ns;
    }));
  Guesses& guesses = of_[address];
  ++guesses.count;
  guesses.last_ns = now_ns;
  ++unsaid_;
  if (said_ns_ && now_ns - *said_ns_ <= kBetweenMessages_ns) return std::nullopt;
  said_ns_ = now_ns;
  const std::uint64_t count = std::exchange(unsaid_, 0);
  return (count == 1 ? "a request" : std::to_string(count) + " requests") +
         std::string(" with a wrong token, ") + (count == 1 ? "from " : "the last from ") + address;
}

}  // namespace servotwin::daemon
