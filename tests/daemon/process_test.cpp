// servotwind as a process: exit status, messages, signals, what it tells the service manager.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "daemon/store/store.h"
#include "drivers/dds/dds.h"
#include "tests/daemon/ball_screw.h"
#include "tests/daemon/http_client.h"
#include "tests/daemon/stalled_thread.h"
#include "tests/daemon/support.h"
#include "tests/support/certificate.h"
#include "tests/support/process.h"

namespace servotwin::daemon {
namespace {

using testing::HasSubstr;
using testing::StartsWith;

struct Ended {
  int status = -1;  ///< exit status, or 128 + signal
  std::string said;
  [[nodiscard]] auto lines() const { return std::count(said.begin(), said.end(), '\n'); }
};

class Daemon : public test::Process {
 public:
  explicit Daemon(const std::vector<std::string>& arguments, void (*prepare)() = nullptr)
      : Process(words(arguments), {.prepare = prepare}) {}

  /// What the process has printed so far after this text.
  [[nodiscard]] std::string said_after(const std::string& text) {
    const std::size_t at = said().find(text);
    return at == std::string::npos ? "" : said().substr(at + text.size());
  }
  Ended wait_after(int signal) {
    const int status = end(signal);
    return {status, said()};
  }
  Ended wait() { return wait_after(0); }

 private:
  static std::vector<std::string> words(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), test::built("servotwind"));
    return arguments;
  }
};

/// The socket on which a service manager listens.
class NotifySocket {
 public:
  explicit NotifySocket(const std::filesystem::path& path)
      : socket_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::strncpy(address.sun_path, path.c_str(), sizeof address.sun_path - 1);
    EXPECT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    setenv("NOTIFY_SOCKET", path.c_str(), 1);
  }
  NotifySocket(const NotifySocket&) = delete;
  NotifySocket& operator=(const NotifySocket&) = delete;
  ~NotifySocket() {
    unsetenv("NOTIFY_SOCKET");
    close(socket_);
  }
  std::string next() const { return next_within(30'000); }
  /// Drops messages that have been received already.
  void forget() const {
    while (next_within(0) != "nothing") {
    }
  }
  std::string next_within(int timeout_ms) const {
    pollfd waiting{socket_, POLLIN, 0};
    if (poll(&waiting, 1, timeout_ms) <= 0) return "nothing";
    char text[100];
    const ssize_t count = recv(socket_, text, sizeof text, 0);
    return std::string(text, count > 0 ? static_cast<std::size_t>(count) : 0);
  }

 private:
  int socket_;
};

class ServotwindTest : public testing::Test {
 protected:
  /// Without a page by default: another test may use its address at the same time.
  [[nodiscard]] std::vector<std::string> here(const std::string& page = "none") const {
    return {"--store",   directory_.path() / "store",           "--domain", "94",
            "--machine", "process-" + std::to_string(getpid()), "--http",   page};
  }
  [[nodiscard]] std::vector<std::string> here_and(const std::vector<std::string>& more) const {
    std::vector<std::string> all = here();
    all.insert(all.end(), more.begin(), more.end());
    return all;
  }
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(directory_.path() / name) << text;
    return directory_.path() / name;
  }
  TemporaryDirectory directory_;
};

TEST_F(ServotwindTest, WrongUsageIsTwo) {
  for (const std::vector<std::string>& wrong :
       std::vector<std::vector<std::string>>{{"--nonsense"},
                                             {"--domain", "231"},
                                             {"--domain", "x"},
                                             {"--columns", "a=b"},
                                             {"--speed", "2"}}) {
    const Ended ended = Daemon(wrong).wait();
    EXPECT_EQ(ended.status, 2) << wrong[0] << "\n" << ended.said;
    EXPECT_THAT(ended.said, HasSubstr(wrong[0])) << ended.said;
    EXPECT_THAT(ended.said, StartsWith("servotwind: "));
    EXPECT_EQ(ended.lines(), 1) << ended.said;
  }
  EXPECT_THAT(Daemon({"--machin", "mill"}).wait().said,
              HasSubstr("there is no option '--machin'; did you mean '--machine'?"));
  const Ended listen = Daemon({"--http", "localhost:80"}).wait();
  EXPECT_EQ(listen.status, 2);
  EXPECT_THAT(listen.said, HasSubstr("must be ADDRESS:PORT"));
  const Ended help = Daemon({"--help"}).wait();
  EXPECT_EQ(help.status, 0);
  EXPECT_THAT(help.said, HasSubstr("--replay"));
  const Ended version = Daemon({"--version"}).wait();
  EXPECT_EQ(version.status, 0);
  EXPECT_THAT(version.said, testing::MatchesRegex("[0-9]+\\.[0-9]+\\.[0-9]+\n"));
}

TEST_F(ServotwindTest, AConfigurationThatIsWrongIsOneWithALinePerProblem) {
  const std::string file = write("m.toml", "[machine]\nnam = 'x'\n[identify]\nwindow_s = -1\n");
  const Ended ended = Daemon(here_and({"--config", file})).wait();
  EXPECT_EQ(ended.status, 1);
  EXPECT_EQ(ended.said, "servotwind: " + file +
                            ":2:1: machine.nam: there is no such key; did you mean 'name'?\n" +
                            "servotwind: " + file +
                            ":4:12: identify.window_s = -1: must be a number from 1 to 3600 s\n");
}

TEST_F(ServotwindTest, WhatItCannotStartWithIsOneClearLine) {
  write("file", "not a directory");
  const std::vector<std::vector<std::string>> cases{
      here_and({"--config", directory_.path() / "none.toml"}),
      here_and({"--replay", directory_.path() / "none.csv"}),
      {"--store", directory_.path() / "file" / "store", "--domain", "94"},
      {"--store", directory_.path() / "store", "--machine", "a/b", "--http", "none"},
      // Also where the page has its default address: TLS was asked for.
      {"--store", directory_.path() / "store", "--domain", "94", "--config",
       write("tls.toml", "[http]\ntls_certificate = 'file'\ntls_key = 'file'\n")},
  };
  for (const auto& arguments : cases) {
    const Ended ended = Daemon(arguments).wait();
    EXPECT_EQ(ended.status, 1) << ended.said;
    EXPECT_THAT(ended.said, StartsWith("servotwind: "));
    EXPECT_EQ(ended.lines(), 1) << ended.said;
  }
}

TEST_F(ServotwindTest, OnADiskThatRefusesItDoesNotStart) {
  const Ended ended = Daemon(here(), [] {
                        const rlimit little{1024, 1024};  // no file may grow beyond
                        setrlimit(RLIMIT_FSIZE, &little);
                      }).wait();
  EXPECT_EQ(ended.status, 1) << ended.said;
  EXPECT_THAT(ended.said, StartsWith("servotwind: store "));
  EXPECT_EQ(ended.lines(), 1) << ended.said;
}

TEST_F(ServotwindTest, ASecondOneOnTheSameStoreDoesNotStart) {
  Daemon first(here());
  ASSERT_TRUE(first.says("waiting for machine"));
  const Ended second = Daemon(here()).wait();
  EXPECT_EQ(second.status, 1);
  EXPECT_THAT(second.said, HasSubstr("is in use by another servotwind"));
  EXPECT_EQ(first.wait_after(SIGTERM).status, 0);
}

TEST_F(ServotwindTest, AThreadOfALibraryThatIsThereBeforeItTakesNoSignalFromIt) {
  Daemon daemon(here(), [] {
    setenv("LD_PRELOAD", test::built("libearly_thread.so").c_str(), 1);
    setenv("ASAN_OPTIONS", "verify_asan_link_order=0", 1);  // a sanitizer wants to be the first
  });
  ASSERT_TRUE(daemon.says("waiting for machine"));
  daemon.send(SIGHUP);
  const Ended ended = daemon.wait_after(SIGTERM);
  EXPECT_EQ(ended.status, 0) << ended.said;
}

TEST_F(ServotwindTest, AnAddressThatIsTakenIsOneClearLineIfItWasAskedFor) {
  Daemon first(here("127.0.0.1:0"));
  ASSERT_TRUE(first.says("waiting for machine"));
  const std::string address = first.said_after("page at http://");
  const std::string place = address.substr(0, address.find('/'));
  const std::vector<std::string> other{
      "--store", directory_.path() / "other", "--domain", "94", "--machine", "another", "--http",
      place};
  const Ended second = Daemon(other).wait();
  EXPECT_EQ(second.status, 1);
  EXPECT_EQ(second.said, "servotwind: http.listen = '" + place +
                             "': Address already in use; give another address with --http\n");
  Daemon none(std::vector<std::string>{"--store", directory_.path() / "other", "--domain", "94",
                                       "--machine", "another", "--http", "none"});
  ASSERT_TRUE(none.says("waiting for machine"));
  EXPECT_THAT(none.wait_after(SIGTERM).said, testing::Not(HasSubstr("page at")));
  EXPECT_EQ(first.wait_after(SIGTERM).status, 0);
}

TEST_F(ServotwindTest, AModelThatCannotBeUsedIsSaidAndTheOneBeforeIsInForce) {
  const std::string machine = "process-" + std::to_string(getpid());
  {
    Store store(directory_.path() / "store", machine);
    ModelRecord record = record_of(drive());
    store.promote(record, {"", "X", "model_promoted", "made for this test", ""});
    store.promote(record, {"", "X", "model_promoted", "made for this test", ""});
  }
  spoil(directory_.path() / "store", other_models("substr(json, 1, 100)", " WHERE version = 2"));
  const std::string config = write("m.toml", "[[axis]]\nname = 'X'\n");
  Daemon daemon(here_and({"--config", config}));
  ASSERT_TRUE(daemon.says("model of axis X, version 2, cannot be used: "));
  const Ended ended = daemon.wait_after(SIGTERM);
  EXPECT_EQ(ended.status, 0);
  EXPECT_THAT(ended.said, HasSubstr("version 1 is in force"));
}

/// By the name of each thread of a process, the processors that it may use.
std::map<std::string, std::string> processors_of_threads(pid_t process) {
  std::map<std::string, std::string> out;
  const std::string tasks = "/proc/" + std::to_string(process) + "/task";
  for (const auto& thread : std::filesystem::directory_iterator(tasks)) {
    std::ifstream status(thread.path() / "status");
    std::string name;
    for (std::string line; std::getline(status, line);) {
      const std::string value = line.substr(std::min(line.find('\t') + 1, line.size()));
      if (line.starts_with("Name:")) name = value;
      if (line.starts_with("Cpus_allowed_list:")) out[name] = value;
    }
  }
  return out;
}

TEST_F(ServotwindTest, WhatAFrameWakesKeepsToTheProcessorsAskedFor) {
  cpu_set_t allowed;
  ASSERT_EQ(sched_getaffinity(0, sizeof allowed, &allowed), 0);
  std::size_t cpu = 0;
  while (!CPU_ISSET(cpu, &allowed)) ++cpu;
  const std::string asked = std::to_string(cpu);
  const std::string file =
      write("m.toml", "[machine]\nname = \"process-" + std::to_string(getpid()) +
                          "\"\n[[axis]]\nname = \"X\"\nsource = \"dds\"\n[dds]\ndomain = 94\n"
                          "[http]\nlisten = \"none\"\n[real_time]\ncpus = [" +
                          asked + "]\n[store]\ndirectory = \"" +
                          (directory_.path() / "store").string() + "\"\n");
  Daemon daemon({"--config", file});
  std::map<std::string, std::string> threads;
  for (int tenths = 0; tenths < static_cast<int>(10 * test::kPatience_s); ++tenths) {
    threads = processors_of_threads(daemon.id());
    if (threads["real-time loop"] == asked && threads["publisher"] == asked &&
        !threads["recorder"].empty())
      break;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  EXPECT_EQ(threads["real-time loop"], asked) << daemon.said();
  EXPECT_EQ(threads["publisher"], asked);
  EXPECT_EQ(threads["tev"], asked);
  int receiving = 0;
  for (const auto& [name, processors] : threads) {
    if (!name.starts_with("recv")) continue;
    ++receiving;
    EXPECT_EQ(processors, asked) << name;
  }
  EXPECT_GT(receiving, 0);
  // All others may use what the process may.
  EXPECT_EQ(threads["recorder"], processors_of_threads(getpid()).begin()->second);
}

TEST_F(ServotwindTest, StopsCleanlyWhenAskedToAndIgnoresAHangup) {
  const std::string config = write("m.toml", "[[axis]]\nname = 'X'\n");
  for (const int signal : {SIGTERM, SIGINT}) {
    const NotifySocket manager(directory_.path() / ("notify-" + std::to_string(signal)));
    Daemon daemon(here_and({"--config", config}));
    ASSERT_EQ(manager.next(), "READY=1");
    daemon.send(SIGHUP);
    const Ended ended = daemon.wait_after(signal);
    EXPECT_EQ(ended.status, 0) << ended.said;
    EXPECT_THAT(ended.said, HasSubstr("servotwind: stopped after 0 frames\n"));
  }
}

TEST_F(ServotwindTest, TellsTheServiceManagerWhenItIsReadyAndWhenItStops) {
  const NotifySocket manager(directory_.path() / "notify");
  Daemon daemon(here());
  EXPECT_EQ(manager.next(), "READY=1");
  daemon.send(SIGTERM);
  EXPECT_EQ(manager.next(), "STOPPING=1");
  EXPECT_EQ(daemon.wait().status, 0);
}

TEST_F(ServotwindTest, TheWatchdogIsFedAsLongAsTheLoopTurnsAlsoInSilence) {
  setenv("WATCHDOG_USEC", "800000", 1);
  const NotifySocket manager(directory_.path() / "notify");
  Daemon daemon(here_and({"--config", write("m.toml", "[[axis]]\nname = 'X'\n")}));
  ASSERT_EQ(manager.next(), "READY=1");
  unsetenv("WATCHDOG_USEC");
  for (int i = 0; i < 10; ++i) EXPECT_EQ(manager.next(), "WATCHDOG=1");
  {
    const StalledThread stalled(daemon.id(), "real-time loop");
    ASSERT_TRUE(daemon.says("the real-time loop has made no progress for 0.4 s"));
    manager.forget();
    EXPECT_EQ(manager.next_within(2000), "nothing") << "all threads but the loop run";
  }
  EXPECT_EQ(manager.next(), "WATCHDOG=1") << "it gets on again";
  EXPECT_EQ(daemon.wait_after(SIGTERM).status, 0);
}

/// With the axes in the configuration the daemon runs; without them it waits for a machine.
class HangupTest : public ServotwindTest, public testing::WithParamInterface<std::string> {};

TEST_P(HangupTest, TheConfigurationIsReadAgain) {
  const std::string text = GetParam() + "[identify]\nwindow_s = ";
  const NotifySocket manager(directory_.path() / "notify");
  const std::string file = write("m.toml", text + "8\n");
  Daemon daemon(here_and({"--config", file}));
  ASSERT_EQ(manager.next(), "READY=1");
  write("m.toml", text +
                      "9\n[http]\nnames = ['mill']\ntoken = 'for the foreman alone'\n"
                      "[real_time]\npriority = 0\n");
  daemon.send(SIGHUP);
  ASSERT_TRUE(
      daemon.says("a new http.token, identify.window_s = 9 (was 8); needs a restart: http.names = "
                  "[ 'mill' ] (was its default), real_time.priority = 0 (was its default)\n"));
  EXPECT_THAT(manager.next(), testing::MatchesRegex("RELOADING=1\nMONOTONIC_USEC=[0-9]+"));
  EXPECT_EQ(manager.next(), "READY=1");
  write("m.toml", text + "'nine'\nwindow = 1\n");
  daemon.send(SIGHUP);
  ASSERT_TRUE(daemon.says("the new configuration is refused; the previous one stays in force"));
  const Ended ended = daemon.wait_after(SIGTERM);
  EXPECT_EQ(ended.status, 0);
  EXPECT_THAT(ended.said, testing::Not(HasSubstr("foreman")));
  EXPECT_THAT(ended.said, HasSubstr("m.toml:4:12: identify.window_s = 'nine': must be a number"));
  EXPECT_THAT(ended.said, HasSubstr("m.toml:5:1: identify.window: there is no such key"));
}
INSTANTIATE_TEST_SUITE_P(RunningAndWaiting, HangupTest,
                         testing::Values("[[axis]]\nname = 'X'\n", "\n\n"));

TEST_P(HangupTest, AKeyOfVeryManyPartsIsRefusedAndTheDaemonRunsOn) {
  const NotifySocket manager(directory_.path() / "notify");
  const std::string file = write("m.toml", GetParam());
  Daemon daemon(here_and({"--config", file}));
  ASSERT_EQ(manager.next(), "READY=1");
  std::string key = "a";
  for (int i = 1; i < 20'000; ++i) key += ".a";
  write("m.toml", GetParam() + key + " = 1\n");
  daemon.send(SIGHUP);
  ASSERT_TRUE(daemon.says("the new configuration is refused; the previous one stays in force"));
  EXPECT_THAT(daemon.said(), HasSubstr("m.toml:3:64: a key has more than 32 parts"));
  write("m.toml", GetParam() + "[identify]\nwindow_s = 9\n");
  daemon.send(SIGHUP);
  EXPECT_TRUE(daemon.says("identify.window_s = 9"));
  EXPECT_EQ(daemon.wait_after(SIGTERM).status, 0);
}

TEST_P(HangupTest, ANewTokenInItsFileIsNeededAtOnce) {
  const auto disarm = [](std::uint16_t port, const std::string& token) {
    return ask(port, "POST", "/api/v1/offsets/disarm", "Authorization: Bearer " + token + "\r\n")
        .status;
  };
  const NotifySocket manager(directory_.path() / "notify");
  write("token", "the first token of all\n");
  const std::string file = write("m.toml", GetParam() + "[http]\ntoken_file = 'token'\n");
  std::vector<std::string> arguments = here("127.0.0.1:0");
  arguments.insert(arguments.end(), {"--config", file});
  Daemon daemon(arguments);
  ASSERT_EQ(manager.next(), "READY=1");
  ASSERT_TRUE(daemon.says("page at http://127.0.0.1:"));
  const auto port =
      static_cast<std::uint16_t>(std::stoi(daemon.said_after("page at http://127.0.0.1:")));
  EXPECT_EQ(disarm(port, "the second token of all"), 401);
  EXPECT_NE(disarm(port, "the first token of all"), 401);
  write("token", "the second token of all\n");
  daemon.send(SIGHUP);
  ASSERT_TRUE(daemon.says("configuration read again: a new http.token\n"));
  EXPECT_NE(disarm(port, "the second token of all"), 401);
  EXPECT_EQ(disarm(port, "the first token of all"), 401);
  write("token", "short\n");
  daemon.send(SIGHUP);
  ASSERT_TRUE(daemon.says("the new configuration is refused"));
  EXPECT_NE(disarm(port, "the second token of all"), 401);
  const Ended ended = daemon.wait_after(SIGTERM);
  EXPECT_EQ(ended.status, 0);
  EXPECT_THAT(ended.said, HasSubstr("token: is too short: a token has 16 to 256 characters"));
  EXPECT_THAT(ended.said, testing::Not(HasSubstr("of all")));
}

TEST_P(HangupTest, ARenewedCertificateIsServedAtOnce) {
  const std::filesystem::path certificate = directory_.path() / "c.pem",
                              key = directory_.path() / "k.pem";
  test::make_certificate(certificate, key, 2);
  const NotifySocket manager(directory_.path() / "notify");
  const std::string file =
      write("m.toml", GetParam() + "[http]\ntls_certificate = 'c.pem'\ntls_key = 'k.pem'\n");
  std::vector<std::string> arguments = here("127.0.0.1:0");
  arguments.insert(arguments.end(), {"--config", file});
  Daemon daemon(arguments);
  ASSERT_EQ(manager.next(), "READY=1");
  ASSERT_TRUE(daemon.says("the certificate in http.tls_certificate expires soon: "));
  const std::string place = daemon.said_after("page at https://");
  const auto verifies = [&] {
    test::Process client({"sh", "-c",
                          "openssl s_client -connect " + place.substr(0, place.find('/')) +
                              " -CAfile " + certificate.string() + " < /dev/null"});
    (void)client.end();
    return client.said().find("Verify return code: 0 (ok)") != std::string::npos;
  };
  EXPECT_TRUE(verifies());
  test::make_certificate(certificate, key);
  EXPECT_FALSE(verifies());
  daemon.send(SIGHUP);
  ASSERT_TRUE(daemon.says("configuration read again: a new certificate\n"));
  EXPECT_TRUE(verifies());
  write("k.pem", "no key\n");
  daemon.send(SIGHUP);
  ASSERT_TRUE(daemon.says("the new configuration is refused"));
  EXPECT_TRUE(verifies());
  EXPECT_EQ(daemon.wait_after(SIGTERM).status, 0) << daemon.said();
}

// Many SIGHUPs while a recording is replayed: no frame is lost.
TEST_F(ServotwindTest, ReadingTheConfigurationAgainLosesNoSample) {
  std::ofstream recording(directory_.path() / "machine.csv");
  recording.precision(12);
  recording << "time[s],X.command[m],X.actual[m]\n";
  for (int i = 0; i < 20'000; ++i)
    recording << i * kCycle_s << ',' << command_at(i * kCycle_s) << ",0\n";
  recording.close();
  const std::string text = "[identify]\nmethod = 'pole-search'\n[diagnose]\nevery_s = 0\n";
  const std::string file = write("m.toml", text);
  Daemon daemon(
      here_and({"--config", file, "--replay", directory_.path() / "machine.csv", "--speed", "10"}));
  ASSERT_TRUE(daemon.says("X: "));
  for (int i = 0; i < 20; ++i) {
    write("m.toml", text + "[store]\nrecordings_mb = " + std::to_string(i + 1) + "\n");
    daemon.send(SIGHUP);
    ASSERT_TRUE(daemon.says("recordings_mb = " + std::to_string(i + 1) + " (was "));
  }
  const Ended ended = daemon.wait();
  EXPECT_EQ(ended.status, 0);
  EXPECT_THAT(ended.said, HasSubstr("servotwind: stopped after 20000 frames\n"));
}

// The whole daemon, while it finds models; the store alone is killed a hundred times in
// store_damage_test.cpp. SERVOTWIN_KILLS: how often.
TEST_F(ServotwindTest, KilledAtRandomMomentsItComesBackWithTheModelItSaidWasInForce) {
  const virtual_machine::AxisRecord record = ball_screw_record(20.0);
  std::ofstream file(directory_.path() / "machine.csv");
  file.precision(12);
  file << "time[s],X.command[m],X.actual[m]\n";
  for (Eigen::Index i = 0; i < record.command.size(); ++i)
    file << static_cast<double>(i) * kCycle_s << ',' << record.command(i) << ',' << record.actual(i)
         << '\n';
  file.close();
  const std::string config =
      write("m.toml",
            "[identify]\nmethod = 'pole-search'\nwindow_s = 1\njudge_s = 0.5\nmin_improvement = 0\n"
            "[diagnose]\nevery_s = 0\n[store]\nrecordings_mb = 1\n");
  const char* asked = std::getenv("SERVOTWIN_KILLS");
  const int kills = asked == nullptr ? 8 : std::atoi(asked);
  std::mt19937_64 random(3);
  int in_force = 0;
  for (int kill_number = 1; kill_number <= kills; ++kill_number) {
    Daemon daemon(here_and(
        {"--config", config, "--replay", directory_.path() / "machine.csv", "--speed", "20"}));
    if (in_force > 0) {
      ASSERT_TRUE(daemon.says("model " + std::to_string(in_force) + " is in force again"))
          << "kill " << kill_number;
    } else {
      ASSERT_TRUE(daemon.says("servotwind: X: model 1 is in force: "));
    }
    usleep(static_cast<useconds_t>(random() % 700'000));
    const Ended ended = daemon.wait_after(SIGKILL);
    ASSERT_EQ(ended.status, 128 + SIGKILL) << ended.said;
    const Store store(directory_.path() / "store", "process-" + std::to_string(getpid()));
    ASSERT_EQ(store.lost(), "");
    const int stored = store.in_force().at(0).record.version;
    for (int version = stored + 1; version < stored + 100; ++version) {
      ASSERT_THAT(ended.said,
                  testing::Not(HasSubstr("model " + std::to_string(version) + " is in force: ")))
          << "it was said, and is not there";
    }
    in_force = stored;
  }
}

// One process watches the machine and diagnoses, another one is started on its store, a third
// (this one) comes last.
TEST_F(ServotwindTest, TheLastDiagnosisIsThereForWhoComesLateAfterARestart) {
  const virtual_machine::AxisRecord record = ball_screw_record(12.0);
  std::ofstream file(directory_.path() / "machine.csv");
  file.precision(12);
  file << "time[s],X.command[m],X.actual[m]\n";
  for (Eigen::Index i = 0; i < record.command.size(); ++i)
    file << static_cast<double>(i) * kCycle_s << ',' << record.command(i) << ',' << record.actual(i)
         << '\n';
  file.close();
  const std::string config =
      write("m.toml", "[identify]\nmethod = 'pole-search'\n[diagnose]\nrecord_s = 10\n");
  const Ended first = Daemon(here_and({"--config", config, "--replay",
                                       directory_.path() / "machine.csv", "--speed", "20"}))
                          .wait();
  ASSERT_EQ(first.status, 0) << first.said;
  ASSERT_THAT(first.said, HasSubstr("servotwind: X: diagnosis of ")) << first.said;

  Daemon second(here_and({"--config", write("n.toml", "[[axis]]\nname = 'X'\n")}));
  const DdsNode node({"process-" + std::to_string(getpid()), 94, ""});
  DdsReader<DiagnosisAnnouncement> diagnoses(node);
  DiagnosisAnnouncement diagnosis;
  ASSERT_TRUE(diagnoses.receive(diagnosis, 30.0));
  EXPECT_EQ(diagnosis.axis, "X");
  EXPECT_THAT(diagnosis.diagnosis_json, HasSubstr("servotwin.diagnosis/1"));
  DdsReader<DiagnosisAnnouncement> later(node);
  DiagnosisAnnouncement again;
  ASSERT_TRUE(later.receive(again, 30.0));
  EXPECT_EQ(again.diagnosis_json, diagnosis.diagnosis_json);
  EXPECT_EQ(second.wait_after(SIGTERM).status, 0);
}

}  // namespace
}  // namespace servotwin::daemon
