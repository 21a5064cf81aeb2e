#include "daemon/config/reload.h"

#include <algorithm>
#include <array>
#include <map>
#include <string_view>

namespace servotwin::daemon {
namespace {

constexpr std::array<std::string_view, 8> kAtOnce{"http.token",          "http.token_file",
                                                  "identify.",           "diagnose.every_s",
                                                  "diagnose.record_s",   "diagnose.encoder_in_loop",
                                                  "store.recordings_mb", "store.recordings_max_mb"};

bool is_at_once(const std::string& key) {
  return std::any_of(kAtOnce.begin(), kAtOnce.end(), [&](std::string_view one) {
    return one.back() == '.' ? key.starts_with(one) : key == one;
  });
}

/// Keys whose values a log must not show: everybody who can open the page can read the events.
bool is_secret(const std::string& key) { return key == "http.token"; }

std::string joined(const std::vector<std::string>& parts) {
  std::string out;
  for (const std::string& part : parts) out += (out.empty() ? "" : ", ") + part;
  return out;
}

}  // namespace

ConfigChanges changes_between(const Config& running, const Config& newer) {
  std::map<std::string, std::pair<std::string, std::string>> keys;
  for (const auto& [key, value] : running.given) keys[key].first = value;
  for (const auto& [key, value] : newer.given) keys[key].second = value;
  ConfigChanges out;
  for (const auto& [key, values] : keys) {
    const auto& [before, now] = values;
    if (before == now) continue;
    const auto shown = [](const std::string& value) {
      return value.empty() ? std::string("its default") : value;
    };
    (is_at_once(key) ? out.at_once : out.by_restart)
        .push_back(is_secret(key) ? "a new " + key
                                  : key + " = " + shown(now) + " (was " + shown(before) + ")");
  }
  return out;
}

std::string ConfigChanges::text() const {
  if (at_once.empty() && by_restart.empty()) return "configuration read again: nothing changed";
  std::string out = "configuration read again";
  if (!at_once.empty()) out += ": " + joined(at_once);
  if (!by_restart.empty()) out += "; needs a restart: " + joined(by_restart);
  return out;
}

Config reloaded(const Config& running, const Config& newer) {
  Config out = running;
  out.http.token = newer.http.token;
  out.http.token_file = newer.http.token_file;
  out.identify = newer.identify;
  out.diagnose.every_s = newer.diagnose.every_s;
  out.diagnose.record_s = newer.diagnose.record_s;
  out.diagnose.encoder_in_loop = newer.diagnose.encoder_in_loop;
  out.store.recordings_mb = newer.store.recordings_mb;
  out.store.recordings_max_mb = newer.store.recordings_max_mb;
  std::erase_if(out.given, [](const auto& key) { return is_at_once(key.first); });
  for (const auto& key : newer.given) {
    if (is_at_once(key.first)) out.given.insert(key);
  }
  return out;
}

void Reloads::request() {
  const std::lock_guard lock(mutex_);
  if (service_) {
    service_(load_);
  } else {
    waiting_ = true;
  }
}

void Reloads::serve_with(std::function<void(const std::function<Config()>& load)> service) {
  const std::lock_guard lock(mutex_);
  service_ = std::move(service);
  if (service_ && std::exchange(waiting_, false)) service_(load_);
}

}  // namespace servotwin::daemon
