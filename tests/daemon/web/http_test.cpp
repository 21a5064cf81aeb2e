// The daemon over HTTP, on real sockets: what is answered, what is refused, and what a stream says.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sqlite3.h>

#include <chrono>
#include <memory>
#include <thread>

#include "daemon/between/clock.h"
#include "daemon/store/report_file.h"
#include "daemon/web/health.h"
#include "daemon/web/http_server.h"
#include "daemon/web/page.h"
#include "daemon/web/web_service.h"
#include "tests/daemon/http_client.h"
#include "tests/daemon/hung_disk.h"
#include "tests/daemon/prometheus_text.h"
#include "tests/daemon/support.h"
#include "tests/daemon/web/http_fixture.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;
using testing::Not;

TEST_F(HttpTest, ThePageIsServedWithAllItsFilesAndNothingFromElsewhere) {
  const HttpAnswer page = get("/");
  EXPECT_EQ(page.status, 200);
  EXPECT_THAT(page.head, HasSubstr("text/html"));
  EXPECT_THAT(page.head,
              HasSubstr("Content-Security-Policy: default-src 'none'; script-src 'self'"));
  EXPECT_THAT(page.head, Not(HasSubstr("unsafe-inline")));
  EXPECT_THAT(page.head, HasSubstr("X-Content-Type-Options: nosniff"));
  for (const PageFile& file : page_files()) {
    const HttpAnswer answer = get(std::string(file.path));
    EXPECT_EQ(answer.status, 200) << file.path;
    EXPECT_EQ(answer.body, file.content) << file.path;
    // The library contains the address of its project in the licence; nothing is loaded from there.
    if (!file.path.starts_with("/vendor/") && file.path != "/icon.svg") {
      EXPECT_THAT(answer.body, Not(HasSubstr("http://"))) << file.path;
    }
    EXPECT_THAT(answer.body, Not(HasSubstr("<script>"))) << file.path;
    const HttpAnswer again = ask(port_, "GET", std::string(file.path),
                                 "If-None-Match: " + std::string(file.tag) + "\r\n");
    EXPECT_EQ(again.status, 304) << file.path;
    EXPECT_EQ(again.body, "");
  }
  const HttpAnswer head = ask(port_, "HEAD", "/");
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(head.body, "");
}

TEST_F(HttpTest, TheIndexNamesThePathsThatAreThere) {
  show();
  const nlohmann::json index = get("/api/v1").json();
  EXPECT_EQ(index["schema"], "servotwin.index/1");
  EXPECT_EQ(get("/api/v1/").json(), index);
  std::size_t read = 0, changed = 0;
  for (const nlohmann::json& one : index["paths"]) {
    EXPECT_NE(one["what"], "");
    std::string path = one["path"];
    if (path == "/api/v1/stream") continue;  // it does not end
    for (const char* name : {"AXIS", "NAME"}) {
      if (path.ends_with(name)) path.replace(path.size() - 4, 4, "X");
    }
    const HttpAnswer answer = ask(port_, one["method"], path);
    if (one["method"] == "GET") {
      EXPECT_THAT(answer.body, Not(HasSubstr("there is nothing at"))) << path;
      ++read;
    } else {  // a path that cannot be changed is refused before the token is looked at
      EXPECT_EQ(answer.status, 401) << one;
      ++changed;
    }
  }
  EXPECT_EQ(read, 11U) << "as docs/reference.md lists them, without the page";
  EXPECT_EQ(changed, 5U);
}

TEST_F(HttpTest, WhatIsAskedWronglyIsAnErrorThatSaysWhy) {
  show();
  struct Case {
    std::string target;
    int status;
    std::string why;
  };
  for (const Case& one : std::vector<Case>{
           {"/nowhere", 404, "there is nothing at '/nowhere'"},
           {"/api/v1/models/Q", 404, "there is no axis 'Q'; there are X"},
           {"/api/v1/models/..%2f..%2fX", 404, "there is nothing at"},
           {"/api/v1/report/%2e%2e", 404, "there is no axis '..'"},
           {"/api/v1/report/X", 404, "axis 'X' has not been diagnosed yet"},
           {"/api/v1/events?most=0", 400, "most = '0': must be a whole number from 1 to 10000"},
           {"/api/v1/events?most=1e3", 400, "most = '1e3'"},
           {"/api/v1/events?mots=1", 400, "there is no parameter 'mots'; did you mean 'most'?"},
           {"/api/v1/status?x=%ff", 400, "there is no parameter 'x'"},
           {"/%ff%fe", 404, "there is nothing at"}}) {
    const HttpAnswer answer = get(one.target);
    EXPECT_EQ(answer.status, one.status) << one.target;
    EXPECT_EQ(answer.json()["schema"], "servotwin.error/1");
    EXPECT_EQ(answer.json()["status"], one.status);
    EXPECT_THAT(answer.json()["error"].get<std::string>(), HasSubstr(one.why)) << one.target;
  }
}

TEST_F(HttpTest, AnotherNameForThisHostIsRefused) {
  for (const char* host : {"localhost", "LOCALHOST:8402", "127.0.0.1:1", "192.168.7.9",
                           "[::1]:8402", "cell3.example:8402"})
    EXPECT_EQ(ask(port_, "GET", "/api/v1/status", "", "", host).status, 200) << host;
  for (const char* host : {"evil.example", "evil.example:8402", "localhost.evil.example", "[::1",
                           "127.0.0.1.evil.example", "[]"}) {
    const HttpAnswer answer = ask(port_, "GET", "/api/v1/status", "", "", host);
    EXPECT_EQ(answer.status, 421) << host;
    EXPECT_THAT(answer.json()["error"].get<std::string>(), HasSubstr("http.names"));
  }
}

TEST_F(HttpTest, MethodsAndBodiesThatNothingTakesAreRefused) {
  const HttpAnswer patch = ask(port_, "PATCH", "/api/v1/status");
  EXPECT_EQ(patch.status, 405);
  EXPECT_THAT(patch.head, HasSubstr("Allow: GET, HEAD, POST, PUT, DELETE"));
  EXPECT_EQ(ask(port_, "PUT", "/api/v1/status").status, 405);
  EXPECT_EQ(ask(port_, "PUT", "/api/v1/diagnoses/X", "", "x").status, 405);
  EXPECT_EQ(ask(port_, "POST", "/api/v1/status").status, 405);
  EXPECT_EQ(ask(port_, "POST", "/api/v1/diagnoses/X", "", std::string(20'000, 'x')).status, 413);
  // Larger than the limit of a request.
  const HttpAnswer large = ask(port_, "GET", "/" + std::string(40'000, 'x'));
  EXPECT_GE(large.status, 400);
  EXPECT_LT(large.status, 500);
  HttpConnection nonsense(port_);
  nonsense.send("\x16\x03\x01 this is no HTTP\r\n\r\n");
  EXPECT_THAT(nonsense.rest(), Not(HasSubstr("200 OK")));
  EXPECT_EQ(get("/healthz").status, 200);  // it lives
}

TEST_F(HttpTest, WhoChangesSomethingNeedsTheToken) {
  show();
  const auto post = [&](const std::string& authorization) {
    return ask(port_, "POST", "/api/v1/diagnoses/X",
               authorization.empty() ? "" : "Authorization: " + authorization + "\r\n");
  };
  const HttpAnswer without = post("");
  EXPECT_EQ(without.status, 401);
  EXPECT_THAT(without.head, HasSubstr("WWW-Authenticate: Bearer"));
  EXPECT_EQ(post("Bearer a token of the tesT").status, 401);
  EXPECT_EQ(post("Bearer ").status, 401);
  EXPECT_EQ(post(kToken).status, 401);
  EXPECT_EQ(watch_->take_alarm(0), std::nullopt);
  EXPECT_EQ(post(std::string("Bearer ") + kToken).status, 202);
  EXPECT_EQ(watch_->take_alarm(0), "requested over HTTP");
}

TEST_F(HttpTest, WithoutAConfiguredTokenNothingCanBeChanged) {
  HttpConfig config;
  config.listen = "127.0.0.1:0";
  WebService other(config, "mill", store_, events_);
  const auto port = static_cast<std::uint16_t>(std::stoi(other.url().substr(17)));
  const HttpAnswer answer = ask(port, "POST", "/api/v1/diagnoses/X", "Authorization: Bearer \r\n");
  EXPECT_EQ(answer.status, 403);
  EXPECT_THAT(answer.json()["error"].get<std::string>(), HasSubstr("http.token"));
}

TEST_F(HttpTest, APersonWithTheTokenArmsAndDisarms) {
  const auto post = [&](const std::string& what, const std::string& token = kToken) {
    return ask(port_, "POST", "/api/v1/offsets/" + what, "Authorization: Bearer " + token + "\r\n");
  };
  EXPECT_EQ(post("arm").status, 409) << "no machine is known yet";
  show();
  EXPECT_EQ(post("arm", "another token......").status, 401);
  EXPECT_FALSE(armed_);
  EXPECT_EQ(get("/api/v1/offsets").json()["armed"], false);
  EXPECT_EQ(post("arm").status, 200);
  EXPECT_TRUE(armed_);
  const nlohmann::json now = get("/api/v1/offsets").json();
  EXPECT_EQ(now["schema"], "servotwin.offsets/1");
  EXPECT_EQ(now["live"], true);
  EXPECT_EQ(now["armed"], true);
  EXPECT_EQ(get("/api/v1/status").json()["offsets"]["armed"], true);
  EXPECT_EQ(get("/api/v1/offsets/arm").status, 404) << "looking changes nothing";
  EXPECT_EQ(post("disarm").json()["armed"], false);
  EXPECT_FALSE(armed_);
  EXPECT_THAT(said_.str(), HasSubstr("armed: from the next run on"));
}

TEST_F(HttpTest, WhatTheConfigurationDoesNotAllowIsNotArmed) {
  Arming advice(false, armed_, events_);
  shown_ = nullptr;
  watch_ = std::make_unique<ResidualWatch>(machine_, DiagnoseConfig{}, events_);
  shown_ =
      std::make_unique<WebService::Shown>(*web_, machine_, counters_, published_, *watch_, &advice);
  const HttpAnswer answer = ask(port_, "POST", "/api/v1/offsets/arm",
                                std::string("Authorization: Bearer ") + kToken + "\r\n");
  EXPECT_EQ(answer.status, 409);
  EXPECT_THAT(answer.json()["error"].get<std::string>(), HasSubstr("ilc.live"));
  EXPECT_FALSE(armed_);
  shown_ = nullptr;
}

TEST_F(HttpTest, WhatIsForbiddenIsDisarmedAndStaysSo) {
  show();
  const auto arm = [&] {
    return ask(port_, "POST", "/api/v1/offsets/arm",
               std::string("Authorization: Bearer ") + kToken + "\r\n");
  };
  ASSERT_EQ(arm().status, 200);
  arming_.forbid("somebody else sends offsets");
  arming_.forbid("and again");
  EXPECT_FALSE(armed_);
  const HttpAnswer answer = arm();
  EXPECT_EQ(answer.status, 409);
  EXPECT_THAT(answer.json()["error"].get<std::string>(), HasSubstr("somebody else sends offsets"));
  EXPECT_FALSE(armed_);
  EXPECT_THAT(said_.str(), testing::Not(HasSubstr("and again"))) << "told once";
}

TEST_F(HttpTest, SaysWhatIsStored) {
  show();
  promote("the first of them");
  promote("a better one");
  store_.add({"2026-01-31T13:00:00.000Z", "X", "on schedule", "explained",
              R"({"schema":"servotwin.diagnosis/1","verdict":"explained"})", "{}"},
             {"2026-01-31T13:00:00.000Z", "X", "diagnosis", "one cause", R"({"a":1})"});
  write_report(directory_.path(), "mill", "X", "<!doctype html><p>report");

  const nlohmann::json models = get("/api/v1/models").json();
  EXPECT_EQ(models["schema"], "servotwin.models/1");
  ASSERT_EQ(models["axes"].size(), 1U);
  EXPECT_EQ(models["axes"][0]["version"], 2);
  EXPECT_EQ(models["axes"][0]["reason"], "a better one");

  const nlohmann::json versions = get("/api/v1/models/X").json();
  EXPECT_EQ(versions["schema"], "servotwin.versions/1");
  ASSERT_EQ(versions["versions"].size(), 2U);
  EXPECT_EQ(versions["versions"][1]["reason"], "the first of them");
  EXPECT_EQ(versions["versions"][0]["parent"], 1);
  EXPECT_EQ(versions["versions"][0]["fit"]["holdout"]["rms_m"], 1.3e-6);
  EXPECT_EQ(get("/api/v1/models/X?most=1").json()["versions"].size(), 1U);

  const nlohmann::json diagnoses = get("/api/v1/diagnoses/X").json();
  EXPECT_EQ(diagnoses["schema"], "servotwin.diagnoses/1");
  EXPECT_EQ(diagnoses["diagnoses"][0]["verdict"], "explained");
  EXPECT_EQ(diagnoses["diagnoses"][0]["diagnosis"]["schema"], "servotwin.diagnosis/1");

  const nlohmann::json events = get("/api/v1/events?most=2").json();
  EXPECT_EQ(events["schema"], "servotwin.events/1");
  ASSERT_EQ(events["events"].size(), 2U);
  EXPECT_EQ(events["events"][0]["text"], "one cause");
  EXPECT_EQ(events["events"][0]["detail"]["a"], 1);

  const HttpAnswer report = get("/api/v1/report/X");
  EXPECT_EQ(report.body, "<!doctype html><p>report");
  EXPECT_THAT(report.head, HasSubstr("frame-ancestors 'self'"));
  EXPECT_THAT(report.head, Not(HasSubstr("script-src")));  // default-src 'none': no script runs
}

TEST_F(HttpTest, WhatIsStoredIsThereBeforeTheMachineIs) {
  promote("the first of them");
  store_.add({"2026-01-31T13:00:00.000Z", "Y", "on schedule", "explained",
              R"({"schema":"servotwin.diagnosis/1","verdict":"explained"})", "{}"},
             {"2026-01-31T13:00:00.000Z", "Y", "diagnosis", "one cause", ""});
  write_report(directory_.path(), "mill", "Y", "<!doctype html><p>report");
  start();
  const nlohmann::json status = get("/api/v1/status").json();
  EXPECT_EQ(status["state"], "waiting");
  EXPECT_TRUE(status["cycle_s"].is_null());
  ASSERT_EQ(status["axes"].size(), 2U);
  EXPECT_EQ(status["axes"][0]["name"], "X");
  EXPECT_EQ(status["axes"][0]["model_version"], 1);
  EXPECT_EQ(status["axes"][0]["holdout_rms_m"], 1.3e-6);
  EXPECT_EQ(status["axes"][1]["model_version"], 0);
  EXPECT_EQ(get("/api/v1/models/X").json()["versions"].size(), 1U);
  EXPECT_EQ(get("/api/v1/diagnoses/Y").json()["diagnoses"][0]["verdict"], "explained");
  EXPECT_EQ(get("/api/v1/report/Y").body, "<!doctype html><p>report");
  EXPECT_THAT(read_prometheus(get("/metrics").body), Not(testing::IsEmpty()));
  const HttpAnswer asked = ask(port_, "POST", "/api/v1/diagnoses/X",
                               std::string("Authorization: Bearer ") + kToken + "\r\n");
  EXPECT_EQ(asked.status, 409);
  EXPECT_THAT(asked.body, HasSubstr("no machine is known yet"));
  show();
  EXPECT_FALSE(get("/api/v1/status").json()["axes"][0].contains("model_version"))
      << "the machine's axes from here on, of which no status came yet";
}

TEST_F(HttpTest, StatusAndMetricsAreThereBeforeTheMachineIs) {
  const nlohmann::json before = get("/api/v1/status").json();
  EXPECT_EQ(before["schema"], "servotwin.status/1");
  EXPECT_EQ(before["state"], "waiting");
  EXPECT_TRUE(before["axes"].empty());
  EXPECT_EQ(read_prometheus(get("/metrics").body).at("servotwin_healthy").samples[0].value, 1.0);
  show();
  counters_.work.add(5'000);
  published_.add(5'000);
  published_.add(70'000);
  const nlohmann::json after = get("/api/v1/status").json();
  const nlohmann::json& octaves = after["publish_octaves"];
  ASSERT_EQ(octaves.size(), 5U) << "up to 8, 16, 32, 65 and 131 us";
  EXPECT_EQ(octaves[0], (nlohmann::json{{"below_s", 8192e-9}, {"count", 1}}));
  EXPECT_EQ(octaves[1]["count"], 0);
  EXPECT_EQ(octaves[4], (nlohmann::json{{"below_s", 131072e-9}, {"count", 1}}));
  EXPECT_EQ(after["axes"][0]["name"], "X");
  EXPECT_EQ(after["axes"][0]["alarm"], "learning");
  const HttpAnswer metrics = get("/metrics");
  EXPECT_THAT(metrics.head, HasSubstr("text/plain; version=0.0.4"));
  EXPECT_EQ(read_prometheus(metrics.body).at("servotwin_work_seconds").samples.back().value, 1.0);
  shown_.reset();
  EXPECT_TRUE(get("/api/v1/status").json()["axes"].empty());
}

TEST_F(HttpTest, AStreamTellsWhatThePublisherPublishes) {
  show();
  HttpConnection stream(port_);
  stream.send("GET /api/v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n");
  ASSERT_TRUE(stream.has_sent("Content-Type: text/event-stream"));
  const auto said = [&] {
    stream.drain();
    return stream.received();
  };
  MachinePrediction cycle;
  cycle.axis_count = 1;
  cycle.axes[0].measured_error = 2e-6;
  cycle.axes[0].predicted_error = 1.5e-6;
  cycle.axes[0].residual = 0.5e-6;
  for (cycle.sequence = 0; cycle.sequence < 50; ++cycle.sequence) shown_->feed().add(cycle);
  ASSERT_TRUE(tells("event: live\ndata: {\"schema\":\"servotwin.live/1\"", said));
  ASSERT_TRUE(tells("\"residual\":[5e-07", said));
  shown_->feed().add(ModelAnnouncement{"X", 3, 2, "2026-01-31T12:00:00.000Z", "better", "{}"});
  ASSERT_TRUE(tells("event: model\ndata: {", said));
  shown_->feed().add(DiagnosisAnnouncement{"X", R"({"schema":"servotwin.diagnosis/1"})"});
  ASSERT_TRUE(tells("event: diagnosis\ndata: {\"schema\":\"servotwin.diagnosis/1\"}\n\n", said));
  MachineStatus status;
  status.frames = 4711;
  ASSERT_TRUE(tells("\"frames\":4711", said, status));
  // A later reader gets the last seconds at once.
  HttpConnection late(port_);
  late.send("GET /api/v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_TRUE(late.has_sent("\"frames\":4711"));
  EXPECT_THAT(late.received(), HasSubstr("event: live\n"));
  shown_.reset();
  web_.reset();  // the streams end properly
  EXPECT_THAT(late.rest(), testing::EndsWith("0\r\n\r\n"));
}

TEST_F(HttpTest, ThereAreNotMoreStreamsThanAreServed) {
  std::vector<std::unique_ptr<HttpConnection>> streams;
  for (unsigned i = 0; i < Callers::kMaxStreams; ++i) {
    streams.push_back(std::make_unique<HttpConnection>(port_));
    streams.back()->send("GET /api/v1/stream HTTP/1.1\r\nHost: localhost\r\n\r\n");
    ASSERT_TRUE(streams.back()->has_sent("200 OK"));
  }
  const HttpAnswer refused = get("/api/v1/stream");
  EXPECT_EQ(refused.status, 503);
  EXPECT_THAT(refused.json()["error"].get<std::string>(), HasSubstr("16 live streams already"));
  EXPECT_EQ(get("/api/v1/status").status, 200);
}

TEST(HttpServer, AReaderWhoFallsBehindIsDroppedAndTheOthersAreNot) {
  HttpServer server({"127.0.0.1", 0, false}, {}, [](const HttpRequest&) {
    HttpResponse out;
    out.stream = true;
    return out;
  });
  HttpConnection slow(server.address().port), quick(server.address().port);
  for (const HttpConnection* one : {&slow, &quick})
    one->send("GET / HTTP/1.1\r\nHost: localhost\r\n\r\n");
  while (server.streams() < 2) server.poll(10);
  const std::string message = "\"" + std::string(60'000, 'x') + "\"";
  for (std::size_t i = 0; i < 2 * EventStream::kMessagesKept; ++i) {
    server.send("live", message);
    for (int turn = 0; turn < 4; ++turn) {
      server.poll(0);
      quick.drain();
    }
  }
  while (server.streams() > 1) {  // he begins to read again, too late
    slow.drain();
    server.poll(10);
  }
  EXPECT_EQ(server.slow_streams(), 1U);
  server.send("live", "\"the last\"");
  for (int turn = 0; turn < 1000 && quick.received().find("the last") == std::string::npos;
       ++turn) {
    server.poll(10);
    quick.drain();
  }
  EXPECT_THAT(quick.received(), HasSubstr("the last"));
  EXPECT_THAT(slow.received(), Not(HasSubstr("the last")));
}

TEST(HttpServer, APortInUseIsOneClearLine) {
  const HttpServer::Handler nothing = [](const HttpRequest&) { return HttpResponse{}; };
  HttpServer first({"127.0.0.1", 0, false}, {}, nothing);
  const std::string why = message_of([&] { HttpServer second(first.address(), {}, nothing); });
  EXPECT_EQ(why, "http.listen = '" + first.address().text() +
                     "': Address already in use; give another address with --http");
}

TEST(ListenAddress, IsNumbersOnly) {
  EXPECT_EQ(parse_listen_address("127.0.0.1:8402")->text(), "127.0.0.1:8402");
  EXPECT_EQ(parse_listen_address("[::1]:80")->text(), "[::1]:80");
  EXPECT_EQ(parse_listen_address("0.0.0.0:0")->port, 0);
  for (const char* wrong :
       {"", ":80", "8402", "localhost:80", "::1:80", "[::1]", "127.0.0.1:", "127.0.0.1:65536",
        "127.0.0.1:-1", "127.0.0.1:80x", "127.0.0:80", "[]:1"})
    EXPECT_FALSE(parse_listen_address(wrong)) << wrong;
}

class HealthTest : public testing::Test {
 protected:
  TemporaryDirectory directory_;
  Store store_{directory_.path(), "mill"};
  Store reading_{directory_.path(), "mill", StoreAccess::kRead};
  StoreCheck check_{store_, reading_};
  Health health_{check_};
};

TEST_F(HealthTest, ALoopThatStandsStillIsIllAndAMachineThatIsSilentIsNot) {
  health_.on_turns(std::nullopt, 0);
  EXPECT_TRUE(health_.problems(9 * kSecond_ns).empty());  // it waits for its machine
  health_.on_turns(1, 10 * kSecond_ns);
  health_.on_turns(2, 11 * kSecond_ns);
  EXPECT_TRUE(health_.problems(12 * kSecond_ns).empty());
  health_.on_turns(2, 14 * kSecond_ns);
  EXPECT_EQ(health_.problems(14 * kSecond_ns),
            std::vector<std::string>{"the real-time loop has made no progress for 3.0 s"});
  health_.on_turns(3, 15 * kSecond_ns);
  EXPECT_TRUE(health_.problems(15 * kSecond_ns).empty());
  health_.on_turns(std::nullopt, 20 * kSecond_ns);  // it has ended
  EXPECT_TRUE(health_.problems(30 * kSecond_ns).empty());
}

TEST_F(HealthTest, CyclesThatAreNotRecordedThoughTheyShouldBeAreIll) {
  health_.on_recording("cycles are not recorded: there is no room");
  EXPECT_EQ(health_.problems(0),
            std::vector<std::string>{"cycles are not recorded: there is no room"});
  health_.on_recording("");
  EXPECT_TRUE(health_.problems(0).empty());
}

TEST_F(HealthTest, AStoreThatCannotBeWrittenIsIllUntilItCan) {
  sqlite3* other = nullptr;
  ASSERT_EQ(sqlite3_open((directory_.path() / "servotwin.sqlite").c_str(), &other), SQLITE_OK);
  ASSERT_EQ(sqlite3_exec(other, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr), SQLITE_OK);
  check_.look();
  const std::vector<std::string> problems = health_.problems(0);
  ASSERT_EQ(problems.size(), 1U);
  EXPECT_THAT(problems[0], HasSubstr("cannot be written"));
  sqlite3_close(other);
  EXPECT_EQ(health_.problems(0).size(), 1U) << "as of the last look";
  check_.look();
  EXPECT_TRUE(health_.problems(0).empty());
}

TEST_F(HealthTest, ADiskThatDoesNotAnswerIsIll) {
  auto disk = std::make_unique<HungDisk>();
  std::thread looking([&] { check_.look(); });
  HungDisk::wait_for_write();
  const std::int64_t now_ns = steady_ns();
  EXPECT_TRUE(health_.problems(now_ns).empty());
  const std::vector<std::string> problems =
      health_.problems(now_ns + 2 * StoreCheck::kMaxAnswer_ns);
  disk.reset();
  looking.join();
  ASSERT_EQ(problems.size(), 1U);
  EXPECT_THAT(problems[0], HasSubstr(": has not answered for "));
  EXPECT_TRUE(health_.problems(now_ns + 2 * StoreCheck::kMaxAnswer_ns).empty());
}

TEST_F(HealthTest, DamageThatIsFoundWhileItRunsIsIll) {
  store_.add(Event{"2026-01-31T12:00:00.000Z", "X", "noted", "an event", ""});
  check_.look();
  EXPECT_TRUE(health_.problems(0).empty());
  spoil(directory_.path(), "UPDATE events SET text = 'other'");
  EXPECT_THAT(message_of([&] { (void)reading_.events(1); }), HasSubstr("is damaged"));
  check_.look();
  EXPECT_EQ(health_.problems(0),
            std::vector<std::string>{"store " + (directory_.path() / "servotwin.sqlite").string() +
                                     ": is damaged (row 1 of events); restart servotwind, which "
                                     "recovers the rest"});
  EXPECT_FALSE(health_.store(0).damage.empty());
}

TEST_F(HealthTest, AModelThatIsDamagedWhileItRunsIsIll) {
  ModelRecord record = record_of(drive());
  store_.promote(record, {"2026-01-31T12:00:00.000Z", "X", "model_promoted", "first", ""});
  spoil(directory_.path(), "UPDATE models SET reason = 'other'");
  EXPECT_TRUE(store_.in_force().empty());
  check_.look();
  ASSERT_EQ(health_.problems(0).size(), 1U);
  EXPECT_THAT(health_.problems(0)[0], HasSubstr("is damaged (model of axis X, version 1)"));
}

// It works again, but something is lost: nobody should have to find the line in the log.
TEST(HealthOfARecoveredStore, IsWellAndSaysWhatWasLost) {
  const TemporaryDirectory directory;
  {
    Store store(directory.path(), "mill");
    store.add(Event{"2026-01-31T12:00:00.000Z", "X", "noted", "an event", ""});
  }
  spoil(directory.path(), "UPDATE events SET text = 'other'");
  Store store(directory.path(), "mill");
  std::ostringstream said;
  EventLog events(store, said);
  HttpConfig config;
  config.listen = "127.0.0.1:0";
  const WebService web(config, "mill", store, events);
  const std::string url = web.url();
  const auto port = static_cast<std::uint16_t>(std::stoi(url.substr(url.rfind(':') + 1)));
  const HttpAnswer health = ask(port, "GET", "/healthz");
  EXPECT_EQ(health.status, 200);
  EXPECT_TRUE(health.json()["problems"].empty());
  ASSERT_EQ(health.json()["notes"].size(), 1U);
  EXPECT_THAT(health.json()["notes"][0].get<std::string>(), HasSubstr("1 of events"));
  const auto metrics = read_prometheus(ask(port, "GET", "/metrics").body);
  EXPECT_EQ(metrics.at("servotwin_store_lost").samples[0].value, 1.0);
  EXPECT_EQ(metrics.at("servotwin_store_damaged").samples[0].value, 0.0);
}

TEST_F(HttpTest, WhileTheDiskHangsOffsetsAreDisarmedAndTheEventIsStoredLater) {
  show();
  armed_ = true;
  auto disk = std::make_unique<HungDisk>();
  const std::string authorization = std::string("Authorization: Bearer ") + kToken + "\r\n";
  EXPECT_EQ(ask(port_, "POST", "/api/v1/offsets/disarm", authorization).status, 200);
  EXPECT_FALSE(armed_);
  HungDisk::wait_for_write();
  EXPECT_EQ(ask(port_, "POST", "/api/v1/offsets/arm", authorization).status, 200);
  EXPECT_EQ(ask(port_, "POST", "/api/v1/offsets/disarm", authorization).status, 200);
  EXPECT_EQ(get("/healthz").status, 200);
  EXPECT_EQ(read_prometheus(get("/metrics").body).at("servotwin_healthy").samples[0].value, 1.0);
  disk.reset();
  for (int i = 0; i < 600 && store_.events(3).size() < 3; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  const std::vector<Event> events = store_.events(3);
  ASSERT_EQ(events.size(), 3U);
  EXPECT_EQ(events[0].kind, "offsets_disarmed");
  EXPECT_EQ(events[1].kind, "offsets_armed");
}

}  // namespace
}  // namespace servotwin::daemon
