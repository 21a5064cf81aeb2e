// Reading the configuration again while the daemon runs (SIGHUP): which keys change at once, and
// which need a restart.
//
// At once: [identify], from its next step on; every_s, record_s and encoder_in_loop of [diagnose];
// recordings_mb and recordings_max_mb of [store]; token and token_file of [http], and what is in
// the files of its certificate and key (service.cpp). All other keys need a restart; the event
// names those that have changed. A configuration with a problem changes nothing.
#pragma once

#include <functional>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "daemon/config/config.h"

namespace servotwin::daemon {

struct ConfigChanges {
  /// "store.recordings_mb = 100 (was 1024)"; of a secret only its key.
  std::vector<std::string> at_once, by_restart;
  /// One line for people.
  [[nodiscard]] std::string text() const;
};

/// The keys whose values differ between the two files.
[[nodiscard]] ConfigChanges changes_between(const Config& running, const Config& newer);
/// `running` with the new values of all keys that change at once.
[[nodiscard]] Config reloaded(const Config& running, const Config& newer);

/// Passes a request to read the configuration again from the signal thread to the service. A
/// request that comes before the service is ready waits for it. Any thread.
class Reloads {
 public:
  /// `load` reads the configuration; it throws what is wrong with it, one line per problem.
  explicit Reloads(std::function<Config()> load) : load_(std::move(load)) {}

  /// Returns when the configuration has been read, or at once if the service is not ready yet.
  void request();
  /// From now on `service` handles requests; nullptr: nobody does.
  void serve_with(std::function<void(const std::function<Config()>& load)> service);

 private:
  std::function<Config()> load_;
  std::mutex mutex_;
  bool waiting_ = false;
  std::function<void(const std::function<Config()>&)> service_;
};

}  // namespace servotwin::daemon
