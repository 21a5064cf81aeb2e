// A disk that does not answer writes of SQLite, wherever its files are.
#pragma once

#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/types.h>
#include <unistd.h>

#include <condition_variable>
#include <cstddef>
#include <mutex>

namespace servotwin::daemon {

/// As long as it lives, every write waits; one at a time per process.
class HungDisk {
 public:
  HungDisk() {
    {
      const std::lock_guard lock(mutex_);
      hung_ = true;
    }
    sqlite3_vfs* vfs = sqlite3_vfs_find(nullptr);
    for (const char* name : {"pwrite", "pwrite64"})
      EXPECT_EQ(vfs->xSetSystemCall(vfs, name, reinterpret_cast<sqlite3_syscall_ptr>(&waits)),
                SQLITE_OK);
  }
  HungDisk(const HungDisk&) = delete;
  HungDisk& operator=(const HungDisk&) = delete;
  ~HungDisk() {
    {
      const std::lock_guard lock(mutex_);
      hung_ = false;
    }
    changed_.notify_all();
    sqlite3_vfs* vfs = sqlite3_vfs_find(nullptr);
    vfs->xSetSystemCall(vfs, nullptr, nullptr);  // all as they were
  }
  /// Returns when a write waits.
  static void wait_for_write() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [] { return waiting_ > 0; });
  }

 private:
  static ssize_t waits(int file, const void* bytes, std::size_t count, off_t at) {
    {
      std::unique_lock lock(mutex_);
      ++waiting_;
      changed_.notify_all();
      changed_.wait(lock, [] { return !hung_; });
      --waiting_;
    }
    return pwrite(file, bytes, count, at);
  }

  inline static std::mutex mutex_;
  inline static std::condition_variable changed_;
  inline static bool hung_ = false;
  inline static int waiting_ = 0;
};

}  // namespace servotwin::daemon
