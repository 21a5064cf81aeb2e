// The running service for one machine; serve() follows the picture in daemon/README.md.
#pragma once

#include <functional>
#include <iosfwd>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/config/config.h"
#include "drivers/common/messages.h"

namespace servotwin::daemon {

class Journal;
class Reloads;
class ServiceManager;

/// What the service shares with its caller; each pointer may be null.
struct Surroundings {
  const ServiceManager* manager = nullptr;  ///< gets the keep-alive of the real-time loop
  const Journal* journal = nullptr;         ///< gets the events instead of `out`
  Reloads* reloads = nullptr;               ///< passes on requests to read the configuration again
};

/// Runs until `stop` is requested or, with a replay, until the recordings have been processed.
/// `ready` is called as soon as store and network are available. Events go to `out`, one line each.
/// Throws std::runtime_error or std::invalid_argument if it cannot start; later errors are events.
void serve(const Config& config, const std::stop_token& stop, const std::function<void()>& ready,
           std::ostream& out, const Surroundings& surroundings = {});

/// Reasons why serve() could not start with this configuration, as far as they can be found without
/// creating or changing anything: recordings that cannot be replayed, a store that cannot be
/// written, an address that this host does not have. One line each; empty if there are none.
[[nodiscard]] std::vector<std::string> obstacles(const Config& config);
/// Resources that another process uses now: the store, or the address of the page. That is expected
/// if this process is the daemon for which the configuration is meant. One line each.
[[nodiscard]] std::vector<std::string> taken(const Config& config);

}  // namespace servotwin::daemon
