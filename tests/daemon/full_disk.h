// A full disk for SQLite, wherever its files are.
#pragma once

#include <gtest/gtest.h>
#include <sqlite3.h>
#include <sys/types.h>

#include <cerrno>
#include <cstddef>

namespace servotwin::daemon {

/// A disk that is full: SQLite's own system calls give what the kernel gives then.
class FullDisk {
 public:
  FullDisk() {
    sqlite3_vfs* vfs = sqlite3_vfs_find(nullptr);
    EXPECT_EQ(
        vfs->xSetSystemCall(vfs, "pwrite64", reinterpret_cast<sqlite3_syscall_ptr>(&no_space)),
        SQLITE_OK);
    EXPECT_EQ(vfs->xSetSystemCall(vfs, "pwrite", reinterpret_cast<sqlite3_syscall_ptr>(&no_space)),
              SQLITE_OK);
    EXPECT_EQ(
        vfs->xSetSystemCall(vfs, "write", reinterpret_cast<sqlite3_syscall_ptr>(&no_space_at_end)),
        SQLITE_OK);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;
  ~FullDisk() {
    sqlite3_vfs* vfs = sqlite3_vfs_find(nullptr);
    vfs->xSetSystemCall(vfs, nullptr, nullptr);  // all as they were
  }

 private:
  static ssize_t no_space(int, const void*, std::size_t, off_t) {
    errno = ENOSPC;
    return -1;
  }
  static ssize_t no_space_at_end(int, const void*, std::size_t) {
    errno = ENOSPC;
    return -1;
  }
};

}  // namespace servotwin::daemon
