// The configuration read again while the daemon runs (SIGHUP): what changes at once, and what only
// a restart brings.
//
// At once: [identify] from its next step on, every_s, record_s and encoder_in_loop of [diagnose],
// recordings_mb and recordings_max_mb of [store]. Everything else, whatever keys there will be,
// needs a restart and is named. A configuration with a problem changes nothing.
#pragma once

#include <functional>
#include <mutex>
#include <string>
#include <utility>
#include <vector>

#include "daemon/config/config.h"

namespace servotwin::daemon {

struct ConfigChanges {
  /// "store.recordings_mb = 100 (was 1024)"; of a secret only that it is another.
  std::vector<std::string> at_once, by_restart;
  /// One line for people.
  [[nodiscard]] std::string text() const;
};

/// What the keys of the files say otherwise.
[[nodiscard]] ConfigChanges changes_between(const Config& running, const Config& newer);
/// `running` with what changes at once.
[[nodiscard]] Config reloaded(const Config& running, const Config& newer);

/// Hands the wish to read the configuration again from whoever hears it to the service, whenever
/// that has come so far. Any thread.
class Reloads {
 public:
  /// `load` reads the configuration; it throws what is wrong with it, one line per problem.
  explicit Reloads(std::function<Config()> load) : load_(std::move(load)) {}

  /// Returns when the configuration has been read, or at once where the service is not so far.
  void request();
  /// From now on the service takes them; nullptr: not any more.
  void serve_with(std::function<void(const std::function<Config()>& load)> service);

 private:
  std::function<Config()> load_;
  std::mutex mutex_;
  bool waiting_ = false;
  std::function<void(const std::function<Config()>&)> service_;
};

}  // namespace servotwin::daemon
