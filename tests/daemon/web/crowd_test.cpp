// Many connections that nobody wants, on real sockets: somebody with the token gets through.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <memory>
#include <thread>
#include <vector>

#include "daemon/web/http_server.h"
#include "tests/daemon/web/http_fixture.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;
using testing::Not;

using Connections = std::vector<std::unique_ptr<HttpConnection>>;

constexpr const char* kBegun = "POST /api/v1/offsets/disarm HTTP/1.1\r\nHost: localhost\r\nX-A: ";
constexpr const char* kStream = "GET /api/v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n";

double now_s() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

class CrowdTest : public HttpTest {
 protected:
  /// Opens `count` connections with an unfinished request, for those that are closed as well.
  void crowd_in(Connections& slow, std::size_t count, const std::string& from) const {
    slow.resize(count);
    for (auto& one : slow) {
      if (one != nullptr && one->try_sending("x")) continue;
      one = std::make_unique<HttpConnection>(port_, from);
      (void)one->try_sending(kBegun);
    }
  }
  [[nodiscard]] HttpAnswer post(const std::string& what, const std::string& token = kToken,
                                const std::string& from = "") const {
    return ask(port_, "POST", "/api/v1/offsets/" + what, "Authorization: Bearer " + token + "\r\n",
               "", "localhost", from);
  }
};

TEST_F(CrowdTest, ADisarmGetsThroughSlowConnectionsAndSixteenStalledStreams) {
  constexpr int kRounds = 20;
  show();
  Connections streams;
  for (unsigned i = 0; i < Callers::kMaxStreams; ++i) {
    streams.push_back(std::make_unique<HttpConnection>(port_, "127.0.0.2"));
    streams.back()->send(kStream);
    ASSERT_TRUE(streams.back()->has_sent("200 OK"));  // and no more is read from it
  }
  // From another address than that of the one who disarms, from the same, and more than the library
  // itself accepts.
  for (const auto& [crowd, size] :
       {std::pair("127.0.0.2", 80), std::pair("127.0.0.1", 80), std::pair("127.0.0.1", 300)}) {
    Connections slow;
    double sum_s = 0.0, max_s = 0.0;
    for (int round = 0; round < kRounds; ++round) {
      crowd_in(slow, static_cast<std::size_t>(size), crowd);
      ASSERT_EQ(post("arm").status, 200) << crowd << ", round " << round;
      ASSERT_TRUE(armed_);
      crowd_in(slow, static_cast<std::size_t>(size), crowd);
      const double begin_s = now_s();
      ASSERT_EQ(post("disarm").status, 200) << crowd << ", round " << round;
      const double taken_s = now_s() - begin_s;
      ASSERT_FALSE(armed_);
      sum_s += taken_s;
      max_s = std::max(max_s, taken_s);
    }
    EXPECT_LE(std::count_if(slow.begin(), slow.end(),
                            [](const auto& one) { return one->try_sending("x"); }),
              Callers::kMaxPerAddress);
    std::printf("disarm from 127.0.0.1, %d slow connections from %s: mean %.1f ms, max %.1f ms\n",
                size, crowd, 1e3 * sum_s / kRounds, 1e3 * max_s);
  }
}

TEST_F(CrowdTest, AnAnnouncedBodyIsRefusedBeforeItComes) {
  for (const char* announced :
       {"Content-Length: 1000000\r\n", "Content-Length: 1000000\r\nExpect: 100-continue\r\n",
        "Transfer-Encoding: chunked\r\n"}) {
    HttpConnection connection(port_);
    connection.send(std::string("POST /api/v1/offsets/arm HTTP/1.1\r\nHost: localhost\r\n") +
                    announced + "\r\n");
    EXPECT_THAT(connection.rest(), HasSubstr("HTTP/1.1 413 ")) << announced;
    EXPECT_THAT(connection.received(), Not(HasSubstr("100 Continue"))) << announced;
  }
  EXPECT_EQ(ask(port_, "POST", "/api/v1/offsets/arm", "Content-Length: 0\r\n").status, 401)
      << "no body, as a browser announces it";
}

TEST_F(CrowdTest, WhoGuessesTokensWaitsForEveryAnswerAndIsInTheLog) {
  show();
  for (unsigned i = 0; i < TokenGuesses::kGuessesBeforeHold; ++i)
    ASSERT_EQ(post("arm", "a wrong token ......").status, 401);
  for (const auto& [token, status] :
       {std::pair(std::string("another wrong token"), 401), std::pair(std::string(kToken), 200)}) {
    const double begin_s = now_s();
    ASSERT_EQ(post("arm", token).status, status);
    EXPECT_GE(now_s() - begin_s, 1e-9 * static_cast<double>(TokenGuesses::kHold_ns)) << token;
  }
  EXPECT_EQ(post("disarm", kToken, "127.0.0.2").status, 200);
  EXPECT_EQ(get("/api/v1/status").status, 200);
  shown_.reset();
  web_.reset();
  const std::string said = said_.str();
  const std::string line = "a request with a wrong token, from 127.0.0.1";
  ASSERT_THAT(said, HasSubstr(line));
  EXPECT_THAT(said.substr(said.find(line) + line.size()), Not(HasSubstr("wrong token")));
  EXPECT_THAT(said, Not(HasSubstr("another wrong")));
}

TEST_F(CrowdTest, TheServiceEndsWhileAnAnswerIsHeld) {
  for (unsigned i = 0; i < TokenGuesses::kGuessesBeforeHold; ++i)
    ASSERT_EQ(post("arm", "a wrong token ......").status, 401);
  HttpConnection held(port_);
  held.send(
      "POST /api/v1/offsets/arm HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer x\r\n\r\n");
  EXPECT_EQ(get("/api/v1/status").status, 200);  // by then the request has been read
  web_.reset();
  EXPECT_THAT(held.rest(), Not(HasSubstr("200 OK")));
}

TEST(HttpServer, ManyLargeAnswersDoNotDelayAChange) {
  constexpr int kReaders = 40;
  int read = 0, changed = 0;
  HttpServer server({"127.0.0.1", 0, false}, {}, [&](const HttpRequest& request) {
    if (request.method == "POST") {
      ++changed;
      return HttpResponse{};
    }
    ++read;
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
    return HttpResponse{};
  });
  Connections connections;
  for (int i = 0; i <= kReaders; ++i) {
    connections.push_back(std::make_unique<HttpConnection>(server.address().port));
    // A header field does not make a change of it.
    connections.back()->send((i < kReaders ? "GET" : "POST") +
                             std::string(" / HTTP/1.1\r\nHost: localhost\r\nAuthorization: "
                                         "Bearer x\r\n\r\n"));
  }
  while (changed == 0) server.poll(10);
  EXPECT_LT(read, kReaders / 2) << "it came last";
  for (int turn = 0; turn < 1000 && read < kReaders; ++turn) server.poll(10);
  EXPECT_EQ(read, kReaders) << "all the others are answered as well";
}

TEST(LongHttpServer, ARequestByteByByteAndAStreamThatTakesNothingAreEnded) {
  constexpr double kMostWait_s = 120.0;
  HttpServer server({"127.0.0.1", 0, false}, {}, [](const HttpRequest&) {
    HttpResponse out;
    out.stream = true;
    return out;
  });
  HttpConnection slow(server.address().port), stalled(server.address().port),
      reading(server.address().port);
  slow.send("GET / HTTP/1.1\r\nHost: localhost\r\nX-A: ");
  stalled.send(kStream);
  reading.send(kStream);
  while (server.streams() < 2) server.poll(10);
  // As the daemon sends: 20 messages a second, of which the newest 19 seconds are kept.
  const std::string message = "\"" + std::string(60'000, 'x') + "\"";
  const double begin_s = now_s();
  double slow_s = 0.0, stalled_s = 0.0;  // how long they were open
  while ((slow_s == 0.0 || stalled_s == 0.0) && now_s() < begin_s + kMostWait_s) {
    server.send("live", message);
    for (const double turn_s = now_s(); now_s() < turn_s + 0.05;) {
      server.poll(10);
      reading.drain();
    }
    if (slow_s == 0.0 && !slow.try_sending("x")) slow_s = now_s() - begin_s;
    if (stalled_s == 0.0 && server.streams() == 1) stalled_s = now_s() - begin_s;
  }
  EXPECT_GT(slow_s, 9.0) << "its deadline is 10 s";
  EXPECT_GT(stalled_s, 9.0) << "10 s after the last byte that the system took for it";
  EXPECT_EQ(server.slow_streams(), 1U);
  server.send("live", "\"the last\"");
  bool there = false;
  for (int turn = 0; turn < 1000 && !there; ++turn) {
    server.poll(10);
    reading.drain();
    there = reading.received().find("the last") != std::string::npos;
  }
  EXPECT_TRUE(there) << "who reads stays connected";
}

}  // namespace
}  // namespace servotwin::daemon
