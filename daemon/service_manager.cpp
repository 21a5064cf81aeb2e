#include "daemon/service_manager.h"

#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <chrono>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <optional>
#include <utility>

#include "daemon/loop/scheduling.h"

namespace servotwin::daemon {
namespace {

// Checks per watchdog timeout: two of them may come late.
constexpr double kChecksPerTimeout = 4.0;

std::string variable(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? "" : value;
}

}  // namespace

ServiceManager::ServiceManager() : socket_(variable("NOTIFY_SOCKET")) {
  const std::string process = variable("WATCHDOG_PID");
  if (process.empty() || process == std::to_string(getpid()))
    watchdog_s_ = 1e-6 * std::strtod(variable("WATCHDOG_USEC").c_str(), nullptr);
}

void ServiceManager::notify(const std::string& state) const noexcept {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  if (socket_.empty() || socket_.size() >= sizeof address.sun_path) return;
  std::memcpy(address.sun_path, socket_.c_str(), socket_.size());
  if (address.sun_path[0] == '@') address.sun_path[0] = '\0';  // the abstract namespace
  const int socket = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  if (socket < 0) return;
  const auto length = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + socket_.size());
  sendto(socket, state.data(), state.size(), MSG_NOSIGNAL,
         reinterpret_cast<const sockaddr*>(&address), length);
  close(socket);
}

Watchdog::Watchdog(const ServiceManager& manager, int loop_priority,
                   std::function<void(double silent_s)> stalled)
    : manager_(manager), loop_priority_(loop_priority), stalled_(std::move(stalled)) {
  if (manager_.watchdog_s() > 0.0)
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

void Watchdog::watch(const std::atomic<std::uint64_t>* turns) {
  const std::lock_guard lock(mutex_);
  turns_ = turns;
}

void Watchdog::run(const std::stop_token& stop) {
  name_thread("watchdog");
  // If this is not permitted, it is not permitted for the loop either, which reports it.
  if (loop_priority_ > 0) (void)become_real_time(loop_priority_ + 1);
  const std::chrono::duration<double> look(manager_.watchdog_s() / kChecksPerTimeout);
  const std::atomic<std::uint64_t>* watched = nullptr;
  std::uint64_t seen = 0;
  int silent = 0;
  std::unique_lock lock(mutex_);
  while (!stop.stop_requested()) {
    const std::uint64_t now = turns_ == nullptr ? 0 : turns_->load(std::memory_order_relaxed);
    const bool gets_on = turns_ == nullptr || turns_ != watched || now != seen;
    watched = turns_;
    seen = now;
    silent = gets_on ? 0 : silent + 1;
    if (gets_on) manager_.notify("WATCHDOG=1");
    if (silent == static_cast<int>(kChecksPerTimeout) / 2) stalled_(silent * look.count());
    wake_.wait_for(lock, stop, look, [] { return false; });
  }
}

}  // namespace servotwin::daemon
