// Who has sent wrong tokens. From the third one of an address on, every request with a token from
// there is held for a second before its token is compared, right or wrong: an answer that came at
// once only for the right one would tell which it is. With 48 connections an address then tries 48
// tokens a second at most. It is forgotten after a minute without a wrong token.
//
// Times: steady clock [ns]. One thread; errors: none.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

namespace servotwin::daemon {

class TokenGuesses {
 public:
  static constexpr unsigned kGuessesBeforeHold = 3;  ///< a person mistypes
  static constexpr std::int64_t kHold_ns = 1'000'000'000;
  static constexpr std::int64_t kForgotten_ns = 60'000'000'000;
  static constexpr std::int64_t kBetweenMessages_ns = 60'000'000'000;
  static constexpr std::size_t kMaxAddresses = 1024;  ///< beyond it the oldest is forgotten

  /// Whether a request with a token from there must be held for kHold_ns.
  [[nodiscard]] bool must_wait(const std::string& address, std::int64_t now_ns) const;
  /// A token was wrong. The message for the log, at most one per kBetweenMessages_ns.
  [[nodiscard]] std::optional<std::string> add(const std::string& address, std::int64_t now_ns);

 private:
  struct Guesses {
    unsigned count = 0;
    std::int64_t last_ns = 0;
  };
  std::map<std::string, Guesses> of_;
  std::uint64_t unsaid_ = 0;
  std::optional<std::int64_t> said_ns_;
};

}  // namespace servotwin::daemon
