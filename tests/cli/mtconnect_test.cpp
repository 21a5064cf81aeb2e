// servotwin mtconnect with agents: readers written after "SHDR Protocol Companion Specification"
// 1.2, and after the cases of the tokenizer's test in github.com/mtconnect/cppagent
// (test_package/shdr_tokenizer_test.cpp).
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <regex>
#include <set>
#include <sstream>
#include <thread>

#include "cli/live/shdr.h"
#include "fake_daemon.h"
#include "program.h"
#include "tests/support/process.h"

namespace servotwin {
namespace {

using test::FakeDaemon;
using test::Process;
using testing::ElementsAre;
using testing::HasSubstr;
using Words = std::vector<std::string>;

DdsPlace adapter_place() { return test::place_of_test("mtconnect-test"); }

/// A line as agents take it apart: bars divide it, spaces around a word do not count, and in a word
/// in quotation marks a backslash takes the meaning from the character behind it.
Words words_of(const std::string& line) {
  Words out;
  std::size_t at = 0;
  while (at <= line.size()) {
    while (at < line.size() && line[at] == ' ') ++at;
    std::string word;
    std::optional<std::size_t> end;
    if (at < line.size() && line[at] == '"') {
      for (std::size_t i = at + 1; i < line.size() && line[i] != '|'; ++i) {
        if (line[i] == '"') {
          const std::size_t next = line.find_first_not_of(' ', i + 1);
          if (next == line.npos || line[next] == '|') end = next == line.npos ? line.size() : next;
          break;
        }
        if (line[i] == '\\') ++i;
        if (i < line.size()) word += line[i];
      }
    }
    if (!end) {
      end = std::min(line.find('|', at), line.size());
      word = line.substr(at, *end - at);
    }
    while (!word.empty() && word.back() == ' ') word.pop_back();
    out.push_back(word);
    at = *end + 1;
  }
  return out;
}

class Agent {
 public:
  explicit Agent(int port) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
  }
  Agent(const Agent&) = delete;
  Agent& operator=(const Agent&) = delete;
  ~Agent() { ::close(socket_); }

  void say(const std::string& text) const {
    EXPECT_EQ(::send(socket_, text.data(), text.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(text.size()));
  }
  /// Takes what comes within this time; false once the server has ended the connection.
  bool listen(int wait_ms) {
    pollfd one{socket_, POLLIN, 0};
    if (::poll(&one, 1, wait_ms) <= 0) return true;
    char part[65536];
    const ssize_t size = ::recv(socket_, part, sizeof part, 0);
    if (size <= 0) return false;
    rest_.append(part, static_cast<std::size_t>(size));
    for (std::size_t end; (end = rest_.find('\n')) != rest_.npos;) {
      take(rest_.substr(0, end));
      rest_.erase(0, end + 1);
    }
    return true;
  }
  /// Waits until the key has these words.
  [[nodiscard]] bool hears(const std::string& key, const Words& words) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    while (!heard.contains(key) || heard[key] != words) {
      if (std::chrono::steady_clock::now() > until || !listen(20)) return false;
    }
    return true;
  }

  std::map<std::string, Words> heard;  ///< the last words of each key
  std::map<std::string, std::string> times;
  Words commands;
  std::size_t lines = 0;

 private:
  void take(const std::string& line) {
    ++lines;
    if (line.starts_with("*")) {
      commands.push_back(line);
      return;
    }
    const Words words = words_of(line);
    ASSERT_GE(words.size(), 3U) << line;
    times[words[1]] = words[0];
    heard[words[1]] = {words.begin() + 2, words.end()};
  }

  int socket_;
  std::string rest_;
};

/// The program on a free port.
class Served {
 public:
  Served()
      : program_({"servotwin", "mtconnect", "--dds", "--machine", adapter_place().machine,
                  "--domain", std::to_string(adapter_place().domain), "--port", "0"}) {
    EXPECT_TRUE(program_.says(" at 127.0.0.1:")) << program_.said();
    EXPECT_TRUE(program_.says("\n"));
    const std::string& said = program_.said();
    port = std::stoi(said.substr(said.find("127.0.0.1:") + 10));
  }
  [[nodiscard]] Process& program() { return program_; }
  int port = 0;

 private:
  Process program_;
};

// The cases of cppagent, so that the readers of this test are right.
TEST(Shdr, TheReaderIsThatOfTheReferenceAgent) {
  EXPECT_EQ(words_of("hello|kitty|"), (Words{"hello", "kitty", ""}));
  EXPECT_EQ(words_of("   |hello   |   kitty| cat | "), (Words{"", "hello", "kitty", "cat", ""}));
  EXPECT_EQ(words_of(R"(y|"a\|b\|c"|z)"), (Words{"y", "a|b|c", "z"}));
  EXPECT_EQ(words_of(R"(y|"\|b\|c")"), (Words{"y", "|b|c"}));
  EXPECT_EQ(words_of(R"("a\|b\|"|z)"), (Words{"a|b|", "z"}));
  EXPECT_EQ(words_of(R"(y|a\|b")"), (Words{"y", "a\\", "b\""}));
  EXPECT_EQ(words_of(R"(y|"a\|b)"), (Words{"y", "\"a\\", "b"}));
  EXPECT_EQ(words_of("x|y||z"), (Words{"x", "y", "", "z"}));
}

/// The same for agents before 2.0, which know no quotation in messages and conditions.
Words words_of_old_agent(const std::string& line) {
  Words out;
  std::istringstream rest(line);
  for (std::string word; std::getline(rest, word, '|');) out.push_back(word);
  return out;
}

TEST(Shdr, AnyTextIsOneWordForEveryAgent) {
  const std::pair<const char*, const char*> cases[] = {
      {"plain", "plain"},
      {"a|b", "a/b"},
      {"say \"a|b\"", "say 'a/b'"},
      {"\"a\" b", "'a' b"},
      {"\"quoted\"", "'quoted'"},
      {"back\\|slash\\", "back\\/slash\\"},
      {"two\nlines\r\tand\x7f more", "two lines  and  more"}};
  for (const auto& [text, word] : cases) {
    const std::string line = "key|" + cli::shdr_word(text) + "|next";
    EXPECT_EQ(words_of(line), (Words{"key", word, "next"})) << text;
    EXPECT_EQ(words_of_old_agent(line), (Words{"key", word, "next"})) << text;
  }
  EXPECT_EQ(cli::shdr_word("a--multiline--X").find("--multiline--"), std::string::npos);
  EXPECT_EQ(cli::shdr_name("B/1:a b|\n*@"), "B_1_a_b____");
}

TEST(Mtconnect, AgentsSeeWhatTheDaemonSays) {
  Served served;
  Agent agent(served.port), other(served.port);
  ASSERT_TRUE(agent.hears("avail", {"UNAVAILABLE"}));
  FakeDaemon daemon(adapter_place(), "5 % better | \"in\nboth\" directions");
  ASSERT_TRUE(agent.hears("avail", {"AVAILABLE"})) << served.program().said();
  EXPECT_TRUE(agent.hears("X_alarm", {"WARNING", "RESIDUAL", "", "HIGH",
                                      "the residual of axis X is larger than usual"}));
  EXPECT_TRUE(agent.hears("X_model", {"3", "5 % better / 'in both' directions"}));
  EXPECT_TRUE(agent.hears("X_diagnosis", {"", "explained ()"}));
  EXPECT_TRUE(agent.hears("X_error_rms", {"0.302"})) << "mm";
  EXPECT_TRUE(agent.hears("X_error_max", {"0.302"}));
  EXPECT_TRUE(agent.hears("X_predicted_rms", {"0.3"}));
  EXPECT_TRUE(agent.hears("X_residual_rms", {"0.002"}));
  EXPECT_TRUE(agent.hears("X_residual_max", {"0.002"}));
  EXPECT_TRUE(agent.hears("B_1_error_rms", {"0.05729578"})) << "degrees";
  EXPECT_TRUE(agent.hears("B_1_residual_rms", {"UNAVAILABLE"})) << "no model";
  EXPECT_TRUE(agent.hears("B_1_model", {"", "UNAVAILABLE"}));
  EXPECT_TRUE(agent.hears("B_1_alarm", {"UNAVAILABLE", "", "", "", ""})) << "not configured";
  EXPECT_TRUE(agent.hears("contour_rms", {"UNAVAILABLE"})) << "no path";
  const std::string time = R"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z)";
  EXPECT_TRUE(std::regex_match(agent.times["avail"], std::regex(time))) << agent.times["avail"];
  EXPECT_TRUE(std::regex_match(agent.times["X_error_rms"], std::regex(time + R"(@\d+\.\d{3})")));

  daemon.alarm = AlarmState::kWatching;
  EXPECT_TRUE(agent.hears("X_alarm", {"NORMAL", "", "", "", ""}));
  EXPECT_TRUE(other.hears("X_alarm", {"NORMAL", "", "", "", ""}));
  Agent late(served.port);
  EXPECT_TRUE(late.hears("X_model", agent.heard["X_model"])) << "a late agent gets everything";
  EXPECT_EQ(served.program().end(SIGTERM), 0) << served.program().said();
}

TEST(Mtconnect, WithoutItsDaemonEveryValueIsUnavailable) {
  Served served;
  Agent agent(served.port);
  {
    const FakeDaemon daemon(adapter_place());
    ASSERT_TRUE(agent.hears("X_error_rms", {"0.302"})) << served.program().said();
  }
  ASSERT_TRUE(agent.hears("X_diagnosis", {"", "UNAVAILABLE"})) << served.program().said();
  EXPECT_EQ(agent.heard.size(), 2 + 2 * 8U) << "avail, contour, and eight of each axis";
  for (const auto& [key, words] : agent.heard)
    EXPECT_TRUE(words[0] == "UNAVAILABLE" || words[1] == "UNAVAILABLE") << key;
  EXPECT_TRUE(served.program().says("no daemon: every value is UNAVAILABLE"));
}

TEST(Mtconnect, APingIsAnswered) {
  Served served;
  Agent agent(served.port);
  agent.say("* PI");
  agent.say("NG\r\n* unknown: command\n* PING\n");
  while (agent.commands.size() < 2 && agent.listen(1000)) {
  }
  EXPECT_THAT(agent.commands, ElementsAre("* PONG 10000", "* PONG 10000"));
}

/// A server of its own, whose time the test makes.
class Server : public testing::Test {
 protected:
  void serve(double now_s = 0.0) {
    // What was sent to loopback has arrived; an acknowledgement may take another turn.
    for (int turn = 0; turn < 20; ++turn) {
      server_.serve(now_s);
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }
  [[nodiscard]] int port() const { return server_.address().port; }

  cli::ShdrServer server_{{"127.0.0.1", 0, false}};
};

TEST_F(Server, AnAgentThatTakesNothingHoldsNobodyUp) {
  std::string news;
  server_.on_news = [&](const std::string& line) { news += line + "\n"; };
  const Agent asleep(port());
  Agent awake(port());
  serve();
  const std::string text(10'000, 'x');
  constexpr int kLines = 2000;  // 20 MB: what the kernel keeps for a connection, and more
  for (int i = 1; i <= kLines; ++i) {
    server_.set("T", "key", std::to_string(i) + text);
    server_.serve(0.0);
    while (awake.lines < static_cast<std::size_t>(i) && awake.listen(1000)) server_.serve(0.0);
    ASSERT_EQ(awake.lines, static_cast<std::size_t>(i));
  }
  EXPECT_THAT(news, HasSubstr("cut off: it does not take what is sent"));
  EXPECT_EQ(awake.heard["key"], Words{std::to_string(kLines) + text});
}

TEST_F(Server, AnAgentThatSendsWithoutEndHoldsNobodyUp) {
  Agent chatter(port());
  Agent quiet(port());
  serve();
  constexpr std::size_t kPings = 10'000;
  std::string pings;
  for (std::size_t i = 0; i < kPings; ++i) pings += "* PING\n";
  chatter.say(pings);
  server_.set("T", "key", "a");
  server_.serve(0.0);
  EXPECT_TRUE(quiet.hears("key", {"a"}));
  while (!chatter.heard.contains("key")) ASSERT_TRUE(chatter.listen(1000));
  EXPECT_LE(chatter.commands.size(), 4096 / 7U) << "no more than it takes at a time";
  for (int turn = 0; turn < 1000 && chatter.commands.size() < kPings; ++turn) {
    server_.serve(0.0);
    ASSERT_TRUE(chatter.listen(10));
  }
  EXPECT_EQ(chatter.commands.size(), kPings) << "all are answered in the end";
}

TEST_F(Server, AnAgentWithoutSignOfLifeIsCutOff) {
  Agent dead(port()), alive(port()), old(port());  // an old agent does not send any
  dead.say("* PING\n");
  alive.say("* PING\n");
  serve(0.0);
  alive.say("* PING\n");
  serve(19.9);
  server_.set("T", "key", "a");
  serve(20.1);
  while (dead.listen(100) && dead.heard.empty()) {
  }
  EXPECT_TRUE(dead.heard.empty());
  EXPECT_FALSE(dead.listen(1000));
  EXPECT_TRUE(alive.hears("key", {"a"}));
  EXPECT_TRUE(old.hears("key", {"a"}));
}

TEST_F(Server, SaysOnlyWhatChanges) {
  Agent agent(port());
  serve();
  for (const char* value : {"a", "a", "b", "b"}) server_.set("T", "key", value);
  server_.set("T", "last", "x");
  serve();
  ASSERT_TRUE(agent.hears("last", {"x"}));
  EXPECT_EQ(agent.lines, 3U);
}

TEST_F(Server, RefusesWhoIsNoAgentAndWhoIsOneTooMany) {
  std::string news;
  server_.on_news = [&](const std::string& line) { news += line + "\n"; };
  Agent chatter(port());
  chatter.say(std::string(10'000, 'x'));
  serve();
  EXPECT_THAT(news, HasSubstr("speaks no SHDR"));
  std::vector<std::unique_ptr<Agent>> many;
  for (std::size_t i = 0; i <= cli::ShdrServer::kMaxAgents; ++i)
    many.push_back(std::make_unique<Agent>(port()));
  serve();
  EXPECT_FALSE(many.back()->listen(1000));
  server_.set("T", "key", "a");
  serve();
  EXPECT_TRUE(many.front()->hears("key", {"a"}));
  EXPECT_THAT(news, HasSubstr("refused: there are 16 already"));
}

/// The names of all data items.
std::set<std::string> names_in(const std::string& description) {
  std::set<std::string> out;
  const std::regex item("<DataItem id=\"[A-Za-z][A-Za-z0-9._-]*\" name=\"([^\"]+)\"");
  for (std::sregex_iterator one(description.begin(), description.end(), item), end; one != end;
       ++one)
    EXPECT_TRUE(out.insert((*one)[1]).second) << (*one)[1];
  return out;
}

TEST(Mtconnect, TheDeviceDescriptionNamesEveryKey) {
  const FakeDaemon daemon(adapter_place());
  const Answer answer =
      servotwin_says({"mtconnect", "--dds", "--machine", adapter_place().machine, "--domain",
                      std::to_string(adapter_place().domain), "--device"});
  ASSERT_EQ(answer.status, 0) << answer;
  EXPECT_THAT(answer.out,
              HasSubstr("<Rotary id=\"servotwin_" + adapter_place().machine + "_B_1\""));
  Served served;
  Agent agent(served.port);
  ASSERT_TRUE(agent.hears("X_error_rms", {"0.302"}));
  std::set<std::string> keys;
  for (const auto& [key, words] : agent.heard) keys.insert(key);
  EXPECT_EQ(names_in(answer.out), keys);
  const std::set<std::string> shipped =
      names_in(content_of(SERVOTWIN_SOURCE_DIR "/examples/mtconnect/Devices.xml"));
  for (const std::string& key : keys)
    EXPECT_TRUE(key.starts_with("B_1_") || shipped.contains(key)) << key;
}

TEST(Mtconnect, AxesThatWouldHaveTheSameNameAreRefused) {
  const std::vector<std::string> place = {"--dds", "--machine", adapter_place().machine, "--domain",
                                          std::to_string(adapter_place().domain)};
  for (const auto& [second, why] :
       {std::pair("X_alarm",
                  "axis 'X_alarm': its name for MTConnect would be X_alarm, which axis "
                  "'X' has; rename it on the machine"),
        std::pair("path", "would be path, which has another meaning")}) {
    const FakeDaemon daemon(adapter_place(), "better", second);
    for (const std::vector<std::string>& more :
         {std::vector<std::string>{"--device"}, {"--port", "0", "--seconds", "20"}}) {
      std::vector<std::string> all = {"mtconnect"};
      all.insert(all.end(), place.begin(), place.end());
      all.insert(all.end(), more.begin(), more.end());
      const Answer answer = servotwin_says(all);
      EXPECT_EQ(answer.status, 1) << answer;
      EXPECT_THAT(answer.err, HasSubstr(why)) << second;
    }
  }
}

TEST(Mtconnect, AWrongCommandLineIsRefused) {
  for (const char* wrong : {"", "localhost", "1.2.3", "1.2.3.4:5", "::g"}) {
    const Answer answer =
        servotwin_says({"mtconnect", "--dds", "--address", wrong, "--seconds", "0.1"});
    EXPECT_EQ(answer.status, 2) << wrong << answer;
    EXPECT_THAT(answer.err, HasSubstr("--address")) << wrong;
  }
  for (const char* wrong : {"-1", "65536", "1.5", "x"})
    EXPECT_EQ(servotwin_says({"mtconnect", "--port", wrong}).status, 2) << wrong;
  const Served served;
  const Answer taken =
      servotwin_says({"mtconnect", "--port", std::to_string(served.port), "--seconds", "0.1"});
  EXPECT_EQ(taken.status, 1) << taken;
  EXPECT_THAT(taken.err, HasSubstr("give another address with --port"));
}

TEST(Mtconnect, ADaemonThatIsNotThereIsNamedAtTheEnd) {
  const Answer answer =
      servotwin_says({"mtconnect", "--dds", "--machine", adapter_place().machine, "--domain",
                      std::to_string(adapter_place().domain), "--port", "0", "--seconds", "1"});
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.err,
              HasSubstr("no daemon listens to machine '" + adapter_place().machine + "'"));
}

}  // namespace
}  // namespace servotwin
