// servotwin mqtt with a real broker, Mosquitto, and a subscriber; this test is the daemon.
#include <arpa/inet.h>
#include <gmock/gmock.h>
#include <mosquitto.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <set>
#include <thread>

#include "fake_daemon.h"
#include "program.h"
#include "tests/support/certificate.h"
#include "tests/support/process.h"

namespace servotwin {
namespace {

using nlohmann::json;
using test::Process;
using testing::HasSubstr;

DdsPlace bridge_place() { return test::place_of_test("mqtt-test"); }

int free_port() {
  const int socket = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  EXPECT_EQ(::bind(socket, reinterpret_cast<sockaddr*>(&address), size), 0);
  EXPECT_EQ(::getsockname(socket, reinterpret_cast<sockaddr*>(&address), &size), 0);
  ::close(socket);
  return ntohs(address.sin_port);
}

/// What a subscriber to everything has heard: the last payload of each topic, and which of them the
/// broker had kept for it.
class Listener {
 public:
  explicit Listener(int port) : client_(mosquitto_new(nullptr, true, this)) {
    mosquitto_connect_callback_set(client_, [](mosquitto* client, void*, int) {
      mosquitto_subscribe(client, nullptr, "#", 1);
    });
    mosquitto_message_callback_set(
        client_, [](mosquitto*, void* self, const mosquitto_message* message) {
          auto& listener = *static_cast<Listener*>(self);
          const std::lock_guard lock(listener.mutex_);
          listener.heard_[message->topic] = {static_cast<const char*>(message->payload),
                                             static_cast<std::size_t>(message->payloadlen)};
          if (message->retain) listener.kept_.insert(message->topic);
        });
    EXPECT_EQ(mosquitto_connect(client_, "127.0.0.1", port, 60), MOSQ_ERR_SUCCESS);
    mosquitto_loop_start(client_);
  }
  Listener(const Listener&) = delete;
  Listener& operator=(const Listener&) = delete;
  ~Listener() {
    mosquitto_disconnect(client_);
    mosquitto_loop_stop(client_, false);
    mosquitto_destroy(client_);
  }
  [[nodiscard]] std::string on(const std::string& topic) {
    const std::lock_guard lock(mutex_);
    return heard_.contains(topic) ? heard_[topic] : "";
  }
  [[nodiscard]] bool was_kept(const std::string& topic) {
    const std::lock_guard lock(mutex_);
    return kept_.contains(topic);
  }
  /// Waits for a payload that contains this.
  [[nodiscard]] bool hears(const std::string& topic, const std::string& part) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    while (on(topic).find(part) == std::string::npos) {
      if (std::chrono::steady_clock::now() > until) return false;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    return true;
  }

 private:
  mosquitto* client_;
  std::mutex mutex_;
  std::map<std::string, std::string> heard_;
  std::set<std::string> kept_;
};

class Mqtt : public testing::Test {
 protected:
  void SetUp() override { mosquitto_lib_init(); }

  /// A broker that keeps nothing on disk.
  [[nodiscard]] std::unique_ptr<Process> broker(const std::string& more) const {
    const std::string file = folder_.write(
        "broker.conf", "listener " + std::to_string(port_) + " 127.0.0.1\nuser root\n" + more);
    auto out = std::make_unique<Process>(
        std::vector<std::string>{"/usr/sbin/mosquitto", "-v", "-c", file});
    EXPECT_TRUE(out->says("running"));
    return out;
  }
  [[nodiscard]] std::unique_ptr<Process> bridge(const std::string& host = "127.0.0.1",
                                                const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words{"servotwin",
                                   "mqtt",
                                   "--dds",
                                   "--machine",
                                   bridge_place().machine,
                                   "--domain",
                                   std::to_string(bridge_place().domain),
                                   "--broker",
                                   host + ":" + std::to_string(port_),
                                   "--prefix",
                                   "plant/hall 2"};
    words.insert(words.end(), more.begin(), more.end());
    return std::make_unique<Process>(words);
  }
  [[nodiscard]] static std::string topic(const std::string& name) {
    return "plant/hall 2/" + bridge_place().machine + "/" + name;
  }

  Folder folder_;
  int port_ = free_port();
};

TEST_F(Mqtt, PassesOnWhatTheDaemonSays) {
  const auto mosquitto = broker("allow_anonymous true\n");
  const test::FakeDaemon daemon(bridge_place());
  const auto program = bridge();
  ASSERT_TRUE(program->says("connected to 127.0.0.1:")) << program->said();
  {
    Listener first(port_);
    ASSERT_TRUE(first.hears(topic("axis/X/alarm"), "raised"));
  }
  Listener listener(port_);
  ASSERT_TRUE(listener.hears(topic("status"), "\"frames\""));
  const json status = json::parse(listener.on(topic("status")));
  EXPECT_EQ(status.at("schema"), "servotwin.status/1");
  EXPECT_EQ(status.at("machine"), bridge_place().machine);
  EXPECT_EQ(status.at("axes").at(0).at("alarm"), "raised");
  EXPECT_EQ(status.at("axes").at(0).at("model_version"), 3);
  EXPECT_TRUE(status.at("axes").at(1).at("rotary").get<bool>());
  EXPECT_TRUE(listener.hears(topic("axis/X/alarm"), "raised"));
  EXPECT_TRUE(listener.hears(topic("axis/B_1/alarm"), "off")) << "/ would be another level";
  EXPECT_TRUE(listener.hears(topic("axis/X/diagnosis"), "\"explained\""));
  ASSERT_TRUE(listener.hears(topic("axis/X/model"), "better"));
  const json model = json::parse(listener.on(topic("axis/X/model")));
  EXPECT_EQ(model.at("version"), 3);
  EXPECT_EQ(model.at("model").at("schema"), "servotwin.model/1");
  for (const char* name : {"state", "status", "axis/X/alarm", "axis/X/model", "axis/X/diagnosis"})
    EXPECT_TRUE(listener.was_kept(topic(name))) << name;
  EXPECT_TRUE(listener.hears(topic("state"), "online"));
  EXPECT_EQ(program->end(SIGTERM), 0) << program->said();
  EXPECT_TRUE(listener.hears(topic("state"), "offline"));
}

TEST_F(Mqtt, ItsEndIsSaidByTheBrokerWhereItCannot) {
  const auto mosquitto = broker("allow_anonymous true\n");
  const test::FakeDaemon daemon(bridge_place());
  Listener listener(port_);
  {
    const auto program = bridge();
    ASSERT_TRUE(listener.hears(topic("state"), "online"));
  }  // SIGKILL
  EXPECT_TRUE(listener.hears(topic("state"), "offline"));
}

TEST_F(Mqtt, ADaemonThatIsGoneIsSaid) {
  const auto mosquitto = broker("allow_anonymous true\n");
  Listener listener(port_);
  const auto program = bridge();
  {
    const test::FakeDaemon daemon(bridge_place());
    ASSERT_TRUE(listener.hears(topic("state"), "online"));
  }
  EXPECT_TRUE(listener.hears(topic("state"), "no daemon"));
}

TEST_F(Mqtt, ABrokerThatComesLaterOrAgainGetsEverything) {
  const test::FakeDaemon daemon(bridge_place());
  const auto program = bridge();
  ASSERT_TRUE(program->says("no connection to 127.0.0.1:")) << program->said();
  for (int i = 0; i < 2; ++i) {
    const auto mosquitto = broker("allow_anonymous true\n");
    Listener listener(port_);
    EXPECT_TRUE(listener.hears(topic("axis/X/model"), "better")) << i;
    EXPECT_TRUE(listener.hears(topic("state"), "online")) << i;
  }
}

// What a dead connection had not delivered came after what was newer, and stayed.
TEST_F(Mqtt, NothingOldComesAfterAReconnection) {
  auto mosquitto = broker("allow_anonymous true\n");
  test::FakeDaemon daemon(bridge_place());
  const auto program = bridge();
  {
    Listener listener(port_);
    ASSERT_TRUE(listener.hears(topic("axis/X/alarm"), "raised"));
  }
  ASSERT_EQ(::kill(mosquitto->id(), SIGSTOP), 0);
  daemon.alarm = AlarmState::kWatching;
  std::this_thread::sleep_for(std::chrono::seconds(3));  // "watching" is on its way
  mosquitto.reset();
  daemon.alarm = AlarmState::kRaised;
  std::this_thread::sleep_for(std::chrono::seconds(2));  // "raised" again, without a connection
  mosquitto = broker("allow_anonymous true\n");
  Listener listener(port_);
  ASSERT_TRUE(listener.hears(topic("axis/X/alarm"), "raised"));
  std::this_thread::sleep_for(std::chrono::seconds(1));
  EXPECT_EQ(listener.on(topic("axis/X/alarm")), "raised");
}

TEST_F(Mqtt, TheEndOfAnotherBridgeDoesNotStay) {
  const auto mosquitto = broker("allow_anonymous true\n");
  const test::FakeDaemon daemon(bridge_place());
  const auto program = bridge();
  Listener listener(port_);
  ASSERT_TRUE(listener.hears(topic("state"), "online"));
  {
    const auto other = bridge();
    ASSERT_TRUE(other->says("connected to"));
  }
  ASSERT_TRUE(listener.hears(topic("state"), "offline"));
  EXPECT_TRUE(listener.hears(topic("state"), "online"));
}

TEST_F(Mqtt, ItCanBeStoppedWhileTheBrokerIsAway) {
  const auto program = bridge();
  ASSERT_TRUE(program->says("no connection to 127.0.0.1:")) << program->said();
  EXPECT_EQ(program->end(SIGTERM), 0) << program->said();
}

TEST_F(Mqtt, WithPasswordAndCertificate) {
  test::make_certificate(folder_ / "certificate.pem", folder_ / "key.pem");
  test::make_certificate(folder_ / "other.pem", folder_ / "other_key.pem");
  folder_.write("passwords", "mill:secret\n");
  Process hashed({"mosquitto_passwd", "-U", folder_ / "passwords"});
  ASSERT_EQ(hashed.end(), 0) << hashed.said();
  const auto mosquitto =
      broker("allow_anonymous false\npassword_file " + (folder_ / "passwords") + "\ncertfile " +
             (folder_ / "certificate.pem") + "\nkeyfile " + (folder_ / "key.pem") + "\n");
  const test::FakeDaemon daemon(bridge_place());
  const std::string right = folder_.write("right", "secret\n"),
                    wrong = folder_.write("wrong", "guess\n");
  const auto with = [&](const std::string& host, const std::string& ca,
                        const std::string& password) {
    return bridge(host, {"--ca-file", folder_ / ca, "--user", "mill", "--password-file", password});
  };
  EXPECT_TRUE(with("localhost", "certificate.pem", right)->says("connected to localhost:"));
  const auto refused = with("localhost", "certificate.pem", wrong);
  EXPECT_EQ(refused->end(), 1);
  EXPECT_THAT(refused->said(), HasSubstr("refuses the connection"));
  // Another authority, and another name than that of the certificate.
  EXPECT_TRUE(with("localhost", "other.pem", right)->says("no connection to localhost:"));
  EXPECT_TRUE(with("127.0.0.1", "certificate.pem", right)->says("no connection to 127.0.0.1:"));
}

TEST_F(Mqtt, AWrongCommandLineIsRefused) {
  const auto says = [](std::vector<std::string> more) {
    std::vector<std::string> words{"mqtt", "--dds"};
    words.insert(words.end(), more.begin(), more.end());
    return servotwin_says(words);
  };
  for (const char* wrong : {"", ":1883", "host:0", "host:65536", "host:1.5", "host:x", "::1",
                            "[::1", "[::1]x", "[]:1883"}) {
    const Answer answer = says({"--broker", wrong, "--seconds", "0.1"});
    EXPECT_EQ(answer.status, 2) << wrong << answer;
    EXPECT_THAT(answer.err, HasSubstr("--broker")) << wrong;
  }
  for (const char* wrong : {"", "a/+", "#", "/a", "a/"})
    EXPECT_EQ(says({"--broker", "localhost", "--prefix", wrong, "--seconds", "0.1"}).status, 2)
        << wrong;
  EXPECT_EQ(says({}).status, 2) << "without a broker";
  const std::string password = folder_.write("p", "x");
  EXPECT_EQ(says({"--broker", "localhost", "--password-file", password}).status, 2) << "no user";
  const Answer missing =
      says({"--broker", "localhost", "--user", "u", "--password-file", folder_ / "missing"});
  EXPECT_EQ(missing.status, 1) << missing;
  EXPECT_THAT(missing.err, HasSubstr("missing: cannot be read"));
  const Answer no_certificate = says({"--broker", "localhost", "--ca-file", password});
  EXPECT_EQ(no_certificate.status, 1) << no_certificate;
  EXPECT_THAT(no_certificate.err, HasSubstr("has no certificate"));
  const std::string only_end = folder_.write("crlf", "\r\n");
  EXPECT_EQ(says({"--broker", "localhost", "--user", "u", "--password-file", only_end}).status, 1);
}

TEST_F(Mqtt, ABrokerThatIsNotThereIsNamedAtTheEnd) {
  const Answer answer = servotwin_says(
      {"mqtt", "--dds", "--broker", "127.0.0.1:" + std::to_string(port_), "--seconds", "1"});
  EXPECT_EQ(answer.status, 1) << answer;
  EXPECT_THAT(answer.err, HasSubstr("was not reached"));
}

}  // namespace
}  // namespace servotwin
