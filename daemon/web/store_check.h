// Whether the store can be written, and how large the recordings are, found out in a thread of its
// own: a hung disk must not keep requests from their answers.
//
// run() and look(): one thread. seen(): any thread; does not wait for the disk. Errors: none.
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>

#include "daemon/store/store.h"

namespace servotwin::daemon {

class StoreCheck {
 public:
  static constexpr std::int64_t kPeriod_ns = 10'000'000'000;  // every look writes to the disk
  /// Longest answer of a disk that works: five times the longest wait for a lock of another
  /// program.
  static constexpr std::int64_t kMaxAnswer_ns = 10'000'000'000;

  struct Seen {
    std::string problem;  ///< why the store cannot be written; empty: it can
    std::string damage;   ///< Store::found_damage()
    double recordings_bytes = 0.0, recordings_files = 0.0;
  };

  /// `reading`: the same store, opened for reading. Both must outlive the object.
  StoreCheck(Store& store, const Store& reading) : store_(store), reading_(reading) {}

  /// Looks once every kPeriod_ns until it is asked to stop.
  void run(const std::stop_token& stop);
  void look();
  /// The last look. A look that takes longer than kMaxAnswer_ns is a problem.
  [[nodiscard]] Seen seen(std::int64_t now_ns) const;
  /// Store::lost() of the store.
  [[nodiscard]] const std::string& lost() const noexcept { return store_.lost(); }

 private:
  Store& store_;
  const Store& reading_;
  mutable std::mutex mutex_;  // never held while the disk is used
  Seen seen_;
  std::optional<std::int64_t> begun_ns_;  // of the look that goes on
};

}  // namespace servotwin::daemon
