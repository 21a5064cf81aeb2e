#include "daemon/web/store_check.h"

#include <chrono>
#include <condition_variable>
#include <exception>
#include <filesystem>
#include <utility>

#include "daemon/between/clock.h"
#include "diagnosis/statistics/text.h"

namespace servotwin::daemon {

void StoreCheck::run(const std::stop_token& stop) {
  std::mutex mutex;
  std::condition_variable_any never;
  std::unique_lock lock(mutex);
  while (!stop.stop_requested()) {
    look();
    never.wait_for(lock, stop, std::chrono::nanoseconds(kPeriod_ns), [] { return false; });
  }
}

void StoreCheck::look() {
  {
    const std::lock_guard lock(mutex_);
    begun_ns_ = steady_ns();
  }
  Seen now;
  try {
    Store::require_writable(store_.directory());
    store_.try_writing();
  } catch (const std::exception& error) {
    now.problem = error.what();
  }
  now.damage = store_.found_damage();
  if (now.damage.empty()) now.damage = reading_.found_damage();
  std::error_code ignored;
  const auto recordings = store_.directory() / "recordings" / store_.machine();
  for (const auto& file : std::filesystem::directory_iterator(recordings, ignored)) {
    const std::uintmax_t size = file.file_size(ignored);
    if (ignored) continue;  // deleted in the meantime
    now.recordings_bytes += static_cast<double>(size);
    now.recordings_files += 1.0;
  }
  const std::lock_guard lock(mutex_);
  seen_ = std::move(now);
  begun_ns_.reset();
}

StoreCheck::Seen StoreCheck::seen(std::int64_t now_ns) const {
  const std::lock_guard lock(mutex_);
  Seen out = seen_;
  if (begun_ns_ && now_ns - *begun_ns_ > kMaxAnswer_ns)
    out.problem = text("store %s: has not answered for %.0f s", store_.directory().c_str(),
                       1e-9 * static_cast<double>(now_ns - *begun_ns_));
  return out;
}

}  // namespace servotwin::daemon
