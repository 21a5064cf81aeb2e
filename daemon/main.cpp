// servotwind: the daemon. Exit status: 0 stopped as asked; 1 it could not start, the message says
// why; 2 wrong usage.
#include <pthread.h>
#include <signal.h>
#include <sys/stat.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <array>
#include <iostream>
#include <optional>
#include <sstream>
#include <stop_token>
#include <thread>

#include "daemon/arguments.h"
#include "daemon/between/clock.h"
#include "daemon/config/config.h"
#include "daemon/config/listen_address.h"
#include "daemon/config/reload.h"
#include "daemon/service.h"
#include "daemon/service_manager.h"
#include "daemon/store/journal.h"
#include "daemon/unknown_option.h"

namespace servotwin::daemon {
namespace {

/// The thread that waits for signals.
pthread_t waiting_for_signals;

/// Handler for threads that a library started before main() and that therefore do not block the
/// signals (OpenBLAS, which Ceres uses, has such threads): it passes the signal on.
void pass_on(int number) { pthread_kill(waiting_for_signals, number); }

/// Turns SIGTERM and SIGINT into a request to stop, and SIGHUP into a request to read the
/// configuration again. Must be constructed before every other thread of the daemon, so that all of
/// them inherit the blocked signal mask. All arguments must outlive it.
class Signals {
 public:
  Signals(const std::stop_source& stop, const ServiceManager& manager, Reloads& reloads) {
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN);  // a file too large: write() fails, the daemon goes on
    sigemptyset(&wanted_);
    for (const int number : kWanted) sigaddset(&wanted_, number);
    pthread_sigmask(SIG_BLOCK, &wanted_, nullptr);
    thread_ = std::thread([this, stop, &manager, &reloads]() mutable {
      int number = 0;
      while (sigwait(&wanted_, &number) == 0 && number == SIGHUP) {
        manager.notify("RELOADING=1\nMONOTONIC_USEC=" + std::to_string(monotonic_ns() / 1000));
        reloads.request();
        manager.notify("READY=1");
      }
      if (number != SIGUSR1) manager.notify("STOPPING=1");
      stop.request_stop();
    });
    waiting_for_signals = thread_.native_handle();
    struct sigaction action = {};
    action.sa_handler = pass_on;
    action.sa_mask = wanted_;
    action.sa_flags = SA_RESTART;
    for (const int number : kWanted) sigaction(number, &action, nullptr);
  }
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;
  ~Signals() {
    for (const int number : {SIGTERM, SIGINT, SIGHUP}) signal(number, SIG_IGN);
    // If the replayed recordings ended by themselves, the thread still waits in sigwait(): SIGUSR1
    // ends it. Ignoring SIGUSR1 before the join would lose the signal.
    pthread_kill(thread_.native_handle(), SIGUSR1);
    thread_.join();
    signal(SIGUSR1, SIG_IGN);
  }

 private:
  static constexpr std::array kWanted{SIGTERM, SIGINT, SIGHUP, SIGUSR1};
  sigset_t wanted_{};
  std::thread thread_;
};

Config configured(const DaemonArguments& arguments) {
  Config config = arguments.config.empty() ? Config{} : load_config(arguments.config);
  if (!arguments.store.empty()) config.store.directory = arguments.store;
  if (!arguments.machine.empty()) config.machine = arguments.machine;
  for (DdsConfig* dds : {&config.dds, config.dds_in ? &*config.dds_in : nullptr}) {
    if (dds != nullptr && arguments.domain) dds->domain = *arguments.domain;
    if (dds != nullptr && arguments.partition) dds->partition = *arguments.partition;
  }
  if (!arguments.replay.empty()) {
    config.source = SourceKind::kReplay;
    config.replay.files = arguments.replay;
    config.replay.columns = arguments.columns;
  }
  if (arguments.speed) config.replay.speed = *arguments.speed;
  if (!arguments.http.empty()) config.http.listen = arguments.http;
  if (config.http.listen.empty()) {  // not configured: another daemon may use the default address
    config.http.listen = kDefaultListen;
    config.http.needed = false;
  }
  return config;
}

int run(int argc, char** argv, const Journal* journal) {
  CLI::App app(kDaemonDescription, "servotwind");
  DaemonArguments arguments;
  arguments.declare(app, SERVOTWIN_VERSION);
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    const std::string unknown = unknown_option(app);
    std::cerr << "servotwind: " << (unknown.empty() ? error.what() : unknown)
              << " (see servotwind --help)\n";
    return 2;
  }
  // Models, recordings and events concern the owner of the machine only, whoever starts the daemon.
  umask(0077);
  const ServiceManager manager;
  Reloads reloads([&] {
    if (arguments.config.empty())
      throw std::runtime_error(
          "there is no configuration file to read again: the daemon runs without --config");
    return configured(arguments);
  });
  std::stop_source stop;
  const Signals signals(stop, manager, reloads);
  serve(configured(arguments), stop.get_token(), [&] { manager.notify("READY=1"); }, std::cerr,
        {&manager, journal, &reloads});
  return 0;
}

}  // namespace
}  // namespace servotwin::daemon

int main(int argc, char** argv) {
  std::optional<servotwin::daemon::Journal> journal;
  if (servotwin::daemon::Journal::is_behind(STDERR_FILENO)) journal.emplace();
  try {
    return servotwin::daemon::run(argc, argv, journal ? &*journal : nullptr);
  } catch (const std::exception& error) {
    // A configuration error has one line per problem.
    std::istringstream lines(error.what());
    for (std::string line; std::getline(lines, line);) {
      if (!journal ||
          !journal->send(servotwin::daemon::Priority::kError, line, {{"EVENT", "not_started"}}))
        std::cerr << "servotwind: " << line << '\n';
    }
    return 1;
  }
}
