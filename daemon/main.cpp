// servotwind: the daemon. Exit status: 0 stopped as asked; 1 it could not start, the message says
// why; 2 wrong usage.
#include <pthread.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdlib>
#include <cstring>
#include <iostream>
#include <sstream>
#include <stop_token>
#include <thread>

#include "daemon/config.h"
#include "daemon/service.h"
#include "daemon/web/listen_address.h"

namespace servotwin {
namespace {

/// Tells systemd how far we are (sd_notify(3): one datagram to $NOTIFY_SOCKET).
void notify_service_manager(const char* state) {
  const char* path = std::getenv("NOTIFY_SOCKET");
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (path == nullptr || *path == '\0' || std::strlen(path) >= sizeof address.sun_path) return;
  std::memcpy(address.sun_path, path, std::strlen(path));
  if (address.sun_path[0] == '@') address.sun_path[0] = '\0';  // the abstract namespace
  const int socket = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (socket < 0) return;
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + std::strlen(path));
  sendto(socket, state, std::strlen(state), MSG_NOSIGNAL,
         reinterpret_cast<const sockaddr*>(&address), length);
  close(socket);
}

/// Signals become a request to stop. To be made before any other thread, so that all of them block
/// them.
class Signals {
 public:
  explicit Signals(const std::stop_source& stop) {
    signal(SIGHUP, SIG_IGN);
    signal(SIGPIPE, SIG_IGN);
    signal(SIGXFSZ, SIG_IGN);  // a file too large is an error of write(), not the end of the daemon
    sigemptyset(&wanted_);
    for (const int number : {SIGTERM, SIGINT, SIGUSR1}) sigaddset(&wanted_, number);
    pthread_sigmask(SIG_BLOCK, &wanted_, nullptr);
    thread_ = std::thread([this, stop]() mutable {
      int number = 0;
      sigwait(&wanted_, &number);
      if (number != SIGUSR1) notify_service_manager("STOPPING=1");
      stop.request_stop();
    });
  }
  Signals(const Signals&) = delete;
  Signals& operator=(const Signals&) = delete;
  ~Signals() {
    // Where the recordings ended by themselves it waits still.
    pthread_kill(thread_.native_handle(), SIGUSR1);
    thread_.join();
  }

 private:
  sigset_t wanted_{};
  std::thread thread_;
};

struct Arguments {
  std::string config, store, machine, columns, http;
  std::optional<std::uint32_t> domain;
  std::optional<std::string> partition;
  std::vector<std::filesystem::path> replay;
  std::optional<double> speed;
};

Config configured(const Arguments& arguments) {
  Config config = arguments.config.empty() ? Config{} : load_config(arguments.config);
  if (!arguments.store.empty()) config.store.directory = arguments.store;
  if (!arguments.machine.empty()) config.machine = arguments.machine;
  if (arguments.domain) config.dds.domain = *arguments.domain;
  if (arguments.partition) config.dds.partition = *arguments.partition;
  if (!arguments.replay.empty()) {
    config.source = SourceKind::kReplay;
    config.replay.files = arguments.replay;
    config.replay.columns = arguments.columns;
  }
  if (arguments.speed) config.replay.speed = *arguments.speed;
  if (!arguments.http.empty()) config.http.listen = arguments.http;
  if (config.http.listen.empty()) {  // nobody asked: another daemon may have it
    config.http.listen = kDefaultListen;
    config.http.needed = false;
  }
  return config;
}

int run(int argc, char** argv) {
  CLI::App app("The always-on digital twin of a machine's servo drives.", "servotwind");
  app.set_version_flag("--version", SERVOTWIN_VERSION);
  Arguments arguments;
  app.add_option("--config", arguments.config,
                 "Configuration (TOML); without it the defaults hold");
  app.add_option("--store", arguments.store, "Directory of models, events and recordings");
  app.add_option("--machine", arguments.machine, "Name of the machine");
  app.add_option("--domain", arguments.domain, "DDS domain")->check(CLI::Range(0, 230));
  app.add_option("--partition", arguments.partition, "DDS partition of the cell");
  auto* replay = app.add_option("--replay", arguments.replay,
                                "Recordings to replay instead of listening to a machine");
  app.add_option("--columns", arguments.columns,
                 "Names for foreign recordings: X.command=qg[m],...")
      ->needs(replay);
  app.add_option("--speed", arguments.speed, "Times as fast as recorded")
      ->needs(replay)
      ->check(CLI::Range(0.01, 1000.0));
  app.add_option("--http", arguments.http,
                 "Where the page is, ADDRESS:PORT, or none (127.0.0.1:8402)")
      ->check([](const std::string& given) {
        return given == "none" || parse_listen_address(given) ? std::string() : kListenRule;
      });
  try {
    app.parse(argc, argv);
  } catch (const CLI::Success& help) {
    return app.exit(help);
  } catch (const CLI::ParseError& error) {
    std::cerr << "servotwind: " << error.what() << " (see servotwind --help)\n";
    return 2;
  }
  std::stop_source stop;
  const Signals signals(stop);
  serve(
      configured(arguments), stop.get_token(), [] { notify_service_manager("READY=1"); },
      std::cerr);
  return 0;
}

}  // namespace
}  // namespace servotwin

int main(int argc, char** argv) {
  try {
    return servotwin::run(argc, argv);
  } catch (const std::exception& error) {
    // Every problem of a configuration is a line of its own.
    std::istringstream lines(error.what());
    for (std::string line; std::getline(lines, line);) std::cerr << "servotwind: " << line << '\n';
    return 1;
  }
}
