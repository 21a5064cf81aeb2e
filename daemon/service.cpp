#include "daemon/service.h"

#include <memory>
#include <optional>
#include <ostream>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "daemon/between/clock.h"
#include "daemon/config/listen_address.h"
#include "daemon/config/reload.h"
#include "daemon/input/machine_input.h"
#include "daemon/loop/scheduling.h"
#include "daemon/machine_service.h"
#include "daemon/service_manager.h"
#include "daemon/store/event_log.h"
#include "daemon/store/store.h"
#include "daemon/web/http_server.h"
#include "daemon/web/web_service.h"
#include "drivers/common/text.h"
#include "drivers/dds/dds.h"

namespace servotwin::daemon {
namespace {

DdsPlace place_of(const Config& config, const DdsConfig& dds) {
  // Frames pass through threads of Cyclone DDS, which must have the priority of the loop.
  const bool urgent = config.uses(SourceKind::kDds) && config.priority > 0 &&
                      real_time_refused(config.priority).empty();
  return {config.machine, dds.domain, dds.partition, dds.strength, urgent ? config.priority : 0};
}

void note_expiry(const TlsPair& tls, EventLog& events) {
  constexpr std::int64_t kSecond_ns = 1'000'000'000;
  if (const std::string note = expiry_note(tls, wall_ns() / kSecond_ns); !note.empty())
    events.note("http", "", note);
}

/// The page; null if it is not configured, or if it cannot be served and is not required.
std::unique_ptr<WebService> page_of(const Config& config, Store& store, EventLog& events) {
  if (config.http.listen.empty() || config.http.listen == "none") return nullptr;
  try {
    auto web = std::make_unique<WebService>(config.http, config.machine, store, events);
    events.note("http", "", "page at " + web->url());
    note_expiry(read_tls_pair(config.http.tls_certificate, config.http.tls_key), events);
    return web;
  } catch (const BadTlsPair&) {
    throw;  // TLS was asked for
  } catch (const std::runtime_error& error) {
    if (config.http.needed) throw;
    events.note("http", "", std::string("the web page is not served: ") + error.what());
    return nullptr;
  }
}

/// Handles requests to reload the configuration for as long as it lives.
class WhileServing {
 public:
  using Handler = std::function<void(const std::function<Config()>& load)>;
  WhileServing(Reloads* reloads, Handler handler) : reloads_(reloads) {
    if (reloads_ != nullptr) reloads_->serve_with(std::move(handler));
  }
  WhileServing(const WhileServing&) = delete;
  WhileServing& operator=(const WhileServing&) = delete;
  ~WhileServing() {
    if (reloads_ != nullptr) reloads_->serve_with(nullptr);
  }

 private:
  Reloads* reloads_;
};

/// Reads the configuration again and changes the keys of `running` that change at once; reports the
/// result as an event. False, without any change, if the new configuration is refused. `web`: null
/// if there is no page.
bool read_again(const std::function<Config()>& load, Config& running, WebService* web,
                EventLog& events) {
  try {
    const Config newer = load();
    ConfigChanges changes = changes_between(running, newer);
    TlsPair tls;  // the files may have been renewed; other files need a restart
    if (web != nullptr && newer.http.tls_certificate == running.http.tls_certificate &&
        newer.http.tls_key == running.http.tls_key)
      tls = read_tls_pair(newer.http.tls_certificate, newer.http.tls_key);
    running = reloaded(running, newer);
    if (web != nullptr) web->use_token(running.http.token);
    if (tls.given() && web->use_tls(tls)) changes.at_once.emplace_back("a new certificate");
    events.note("reloaded", "", changes.text());
    note_expiry(tls, events);
    return true;
  } catch (const std::exception& error) {
    // Each line of the message is an event.
    std::istringstream lines(error.what());
    for (std::string line; std::getline(lines, line);) events.error("config_refused", "", line);
    events.error("config_refused", "",
                 "the new configuration is refused; the previous one stays in force");
    return false;
  }
}

/// The axes in the store, with their version in force: "X (model 3), Y".
std::string known_axes(const Store& store) {
  std::vector<std::string> out = store.axes();
  const std::vector<StoredModel> models = store.in_force();
  for (std::string& axis : out) {
    for (const StoredModel& model : models) {
      if (model.record.axis != axis) continue;
      axis += " (model " + std::to_string(model.record.version) + ")";
      break;
    }
  }
  return listed(out);
}

std::filesystem::path store_of(const Config& config) {
  return config.store.directory.empty() ? default_store() : config.store.directory;
}

}  // namespace

std::vector<std::string> obstacles(const Config& config) {
  std::vector<std::string> found;
  try {
    Store::require_writable(store_of(config));
    Store::try_making(store_of(config));
  } catch (const std::exception& error) {
    found.emplace_back(error.what());
  }
  for (const int cpu : missing_processors(config.cpus)) {
    found.push_back("real_time.cpus: there is no processor " + std::to_string(cpu) +
                    " on this host");
  }
  for (std::string& obstacle : input_obstacles(config)) found.push_back(std::move(obstacle));
  try {
    (void)read_tls_pair(config.http.tls_certificate, config.http.tls_key);
  } catch (const BadTlsPair& error) {
    found.emplace_back(error.what());
  }
  try {
    if (const auto address = parse_listen_address(config.http.listen))
      HttpServer::try_listening(*address);
  } catch (const CannotListen& error) {
    if (error.error != EADDRINUSE) found.emplace_back(error.what());
  }
  return found;
}

std::vector<std::string> taken(const Config& config) {
  std::vector<std::string> found;
  if (Store::in_use(store_of(config)))
    found.push_back("store " + store_of(config).string() + " is in use by a running servotwind");
  try {
    if (const auto address = parse_listen_address(config.http.listen))
      HttpServer::try_listening(*address);
  } catch (const CannotListen& error) {
    if (error.error == EADDRINUSE) found.push_back(config.http.listen + " is in use");
  }
  return found;
}

void serve(const Config& config, const std::stop_token& stop, const std::function<void()>& ready,
           std::ostream& out, const Surroundings& surroundings) {
  Store store(store_of(config), config.machine);
  EventLog events(store, out, surroundings.journal, config.machine);
  // This write detects a faulty disk now, not with the first model.
  try {
    store.add(event_now("started", "", "started"));
  } catch (const StoreLocked& locked) {  // it passes; the machine is not kept waiting for it
    events.error("store", "", locked.what());
  }
  if (!store.lost().empty()) events.error("store", "", store.lost());
  if (!store.noted().empty()) events.note("store", "", store.noted());
  if (const std::string known = known_axes(store); !known.empty())
    events.note("store", "", "axes in the store: " + known);
  // Frames may have a DDS domain or partition of their own.
  std::optional<DdsNode> common, of_frames;
  {
    // Where a frame wakes the receiving thread, the loop and the publisher on one processor, none
    // of them waits until another processor has left its idle state.
    const WhileKeptTo beside_the_loop(config.cpus);
    common.emplace(place_of(config, config.dds));
    if (config.uses(SourceKind::kDds) && config.dds_in)
      of_frames.emplace(place_of(config, *config.dds_in));
  }
  const DdsNode &node = *common, &node_in = of_frames ? *of_frames : node;
  const std::unique_ptr<WebService> web = page_of(config, store, events);
  // Lives as long as the daemon: the sender of a description waits for a matching reader.
  DdsReader<MachineDescription> descriptions(node_in);
  ready();
  const ServiceManager nobody;
  Watchdog watchdog(
      surroundings.manager != nullptr ? *surroundings.manager : nobody, config.priority,
      [&](double silent_s) {
        events.print(event_now("stalled", "",
                               "the real-time loop has made no progress for " + number(silent_s) +
                                   " s; the service manager will restart the daemon"));
      });

  // The configuration that a reload may change. The loop and its rings do not use it.
  Config running = config;
  std::optional<MachineInput> opened;
  {
    const WhileServing reloading(surroundings.reloads, [&](const std::function<Config()>& load) {
      read_again(load, running, web.get(), events);
    });
    opened = open_input(config, node, node_in, descriptions, stop, events);
  }
  if (!opened) {
    events.note("stopped", "", "stopped before a machine was found");
    return;
  }
  if (config.cycle_s) opened->machine.cycle_s = *config.cycle_s;
  MachineService service({config, store, events, node, node_in, web.get(), watchdog, stop}, *opened,
                         running);
  const WhileServing reloading(surroundings.reloads, [&](const std::function<Config()>& load) {
    if (read_again(load, running, web.get(), events)) service.reconfigure(running);
  });
  service.run();
}

}  // namespace servotwin::daemon
