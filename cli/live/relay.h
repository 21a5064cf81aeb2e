// Listens to a daemon for the programs that pass on what it publishes: to MQTT, to MTConnect, to
// ROS 2. One thread; errors: std::runtime_error (drivers/dds/dds.h).
#pragma once

#include <chrono>
#include <functional>
#include <initializer_list>
#include <map>
#include <string>

#include "cli/common/live_record.h"
#include "cli/live/subscriber.h"

namespace servotwin::cli {

/// The names under which things are passed on, each of one thing.
class PassedNames {
 public:
  /// `where`: "for MTConnect". `reserved`: names of what is no axis.
  PassedNames(std::string where, std::initializer_list<const char*> reserved);
  /// Throws std::runtime_error if this name is taken. `axis`: whose name it is.
  void add(const std::string& name, const std::string& axis);

 private:
  std::string where_;
  std::map<std::string, std::string> whose_;  // an axis; empty: reserved
};

class Relay {
 public:
  explicit Relay(const DdsPlace& place) : subscriber_(place) {}

  /// Until SIGINT or SIGTERM, then true, or for `seconds`, then false; 0: without end. `turn` is
  /// called at least 50 times a second, `pass_on` once a second, with whether the daemon is there;
  /// after it, the figures of the record begin anew.
  bool run(double seconds, const std::function<void()>& turn,
           const std::function<void(bool)>& pass_on);

  /// Since construction.
  [[nodiscard]] double now_s() const {
    return std::chrono::duration<double>(std::chrono::steady_clock::now() - start_).count();
  }
  [[nodiscard]] const LiveRecord& record() const { return record_; }
  [[nodiscard]] Subscriber& subscriber() { return subscriber_; }

 private:
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  Subscriber subscriber_;
  LiveRecord record_;
};

}  // namespace servotwin::cli
