// Lines of SHDR, the text protocol in which adapters tell MTConnect agents what a machine does, and
// the server that sends them.
//
// Sources: "SHDR Protocol Companion Specification" 1.2 (MTC_SHDR.docx in
// github.com/mtconnect/adapter) for lines and heartbeats; github.com/mtconnect/cppagent for how
// agents divide a line (test_package/shdr_tokenizer_test.cpp) and for TIME@DURATION. One thread.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "daemon/config/listen_address.h"

namespace servotwin::cli {

/// A text as one word of a line: bars become strokes, quotation marks apostrophes, and control
/// characters spaces. Bars could be quoted, but agents before 2.0 do not read that in a message.
[[nodiscard]] std::string shdr_word(std::string_view text);

/// What a key, an id or a name of an MTConnect document may consist of; other characters become _.
/// Two texts may become the same (cli/live/relay.h).
[[nodiscard]] std::string shdr_name(std::string_view text);

/// Serves the last value of every key to any number of agents up to kMaxAgents. None waits for
/// another: an agent that takes nothing is cut off, and may come back.
class ShdrServer {
 public:
  static constexpr std::size_t kMaxAgents = 16;
  /// What an agent has not taken yet: minutes of a machine with many axes.
  static constexpr std::size_t kMaxUnsent_bytes = 1 << 20;
  /// How often agents are asked to send a sign of life; after two of these without one, an agent
  /// that has sent some is taken for dead. 10 s is the specification's own example.
  static constexpr int kHeartbeat_ms = 10'000;

  /// Throws std::runtime_error if the address cannot be used.
  explicit ShdrServer(const daemon::ListenAddress& address);
  ~ShdrServer();
  ShdrServer(const ShdrServer&) = delete;
  ShdrServer& operator=(const ShdrServer&) = delete;

  /// Called with one line for people when an agent comes or goes.
  std::function<void(const std::string&)> on_news = [](const std::string&) {};

  /// Sends TIME|KEY|WORDS to all agents, and to those that come later; nothing if the key has these
  /// words already. `words`: with their bars.
  void set(const std::string& time, const std::string& key, const std::string& words);
  /// Takes and answers what has arrived, and sends what agents take; does not wait. `now_s`: of a
  /// clock that does not go back.
  void serve(double now_s);

  /// With the port that was found, where 0 was given.
  [[nodiscard]] const daemon::ListenAddress& address() const { return address_; }

 private:
  struct Agent;
  struct Value {
    std::string words, line;
  };

  void accept_agents();
  /// Why this agent is no longer served; empty: it is.
  [[nodiscard]] std::string attend(Agent& agent, double now_s);

  daemon::ListenAddress address_;
  int socket_ = -1;
  std::map<std::string, Value> values_;
  std::vector<std::unique_ptr<Agent>> agents_;
};

}  // namespace servotwin::cli
