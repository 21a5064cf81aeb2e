// The running service for one machine. Its run() reads as the picture in daemon/README.md.
#pragma once

#include <functional>
#include <iosfwd>
#include <stop_token>
#include <string>
#include <vector>

#include "daemon/config/config.h"
#include "drivers/messages.h"

namespace servotwin::daemon {

class Journal;
class Reloads;
class ServiceManager;

/// What the service shares with whoever runs it; each may be absent.
struct Surroundings {
  const ServiceManager* manager = nullptr;  ///< is told that the real-time loop gets on
  const Journal* journal = nullptr;         ///< takes the events instead of `out`
  Reloads* reloads = nullptr;               ///< wishes to read the configuration again
};

/// Runs until asked to stop or, where recordings are replayed, until they have been worked off.
/// `ready` is called once the store and the network are there. Events go to `out`, one line each.
/// Throws std::runtime_error or std::invalid_argument where it cannot start; while it runs it
/// survives.
void serve(const Config& config, const std::stop_token& stop, const std::function<void()>& ready,
           std::ostream& out, const Surroundings& surroundings = {});

/// Why serve() could not start with this configuration, as far as that can be told without making
/// or changing anything: recordings that cannot be replayed, a store that cannot be written, an
/// address that is none of this host's. One line each; none if it could.
[[nodiscard]] std::vector<std::string> obstacles(const Config& config);
/// What another process has now: the store or the address of the page. Where that is the daemon
/// which is to get this configuration it is as it should be.
[[nodiscard]] std::vector<std::string> taken(const Config& config);

}  // namespace servotwin::daemon
