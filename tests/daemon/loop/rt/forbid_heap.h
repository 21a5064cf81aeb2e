// Counts forbidden operations of a thread: heap, locks, exceptions.
//
// Linked into a test program this file takes the place of malloc and its relatives and of the locks
// of pthread for the whole process, and counts their use by a thread while that thread has
// forbidden it. An exception counts, because it takes memory. Under a sanitizer, which brings its
// own malloc, the heap is seen through the sanitizer's hooks.
#pragma once

#include <cstdint>

namespace servotwin::daemon {

struct Violations {
  std::uint64_t heap = 0;   ///< allocations and releases
  std::uint64_t locks = 0;  ///< mutexes, read-write locks, semaphores
  friend bool operator==(const Violations&, const Violations&) = default;
};

/// Acts on the calling thread.
void forbid_heap_and_locks(bool forbidden) noexcept;
/// Of all threads, since the program started.
[[nodiscard]] Violations violations() noexcept;

/// Forbidden while this lives.
class ForbidHeap {
 public:
  ForbidHeap() noexcept { forbid_heap_and_locks(true); }
  ForbidHeap(const ForbidHeap&) = delete;
  ForbidHeap& operator=(const ForbidHeap&) = delete;
  ~ForbidHeap() { forbid_heap_and_locks(false); }
};

}  // namespace servotwin::daemon
