// A bounded queue from one thread to another, in order; a value that does not fit is dropped and
// counted.
//
// One writer thread, one reader thread; all functions are wait-free and allocate nothing (the
// constructor allocates). Full means that the reader is too slow: the new value is dropped, never
// an old one, because the reader may be looking at the oldest. The other hand-over between threads
// is daemon/between/latest_value.h; there is no third.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <type_traits>
#include <vector>

namespace servotwin::daemon {

template <class T>
class Ring {
  static_assert(std::is_trivially_copyable_v<T>, "crosses threads by value");
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);

 public:
  /// Room for at least `capacity` values: the next power of two.
  explicit Ring(std::size_t capacity) : slots_(power_of_two(capacity)), mask_(slots_.size() - 1) {}

  /// Writer thread only. False, and counted, if there was no room.
  bool push(const T& value) noexcept {
    const std::uint64_t head = head_.load(std::memory_order_relaxed);  // its own
    // acquire: pairs with the release in pop(); the reader is done with the slot to be overwritten.
    if (head - tail_.load(std::memory_order_acquire) > mask_) {
      drops_.fetch_add(1, std::memory_order_relaxed);  // a number for people; orders nothing
      return false;
    }
    slots_[head & mask_] = value;
    // release: pairs with the acquire in pop(); makes the slot visible to the reader.
    head_.store(head + 1, std::memory_order_release);
    return true;
  }

  /// Reader thread only. False if there was nothing.
  bool pop(T& value) noexcept {
    const std::uint64_t tail = tail_.load(std::memory_order_relaxed);  // its own
    // acquire: pairs with the release in push(); makes the slot visible.
    if (tail == head_.load(std::memory_order_acquire)) return false;
    value = slots_[tail & mask_];
    // release: pairs with the acquire in push(); the slot may be overwritten.
    tail_.store(tail + 1, std::memory_order_release);
    return true;
  }

  /// Any thread: values dropped since the start.
  [[nodiscard]] std::uint64_t drops() const noexcept {
    return drops_.load(std::memory_order_relaxed);
  }
  /// Any thread: about how many values wait; exact for the reader if the writer rests.
  [[nodiscard]] std::size_t waiting() const noexcept {
    const std::uint64_t tail =
        tail_.load(std::memory_order_acquire);  // first: it never passes head
    return static_cast<std::size_t>(head_.load(std::memory_order_acquire) - tail);
  }
  [[nodiscard]] std::size_t capacity() const noexcept { return slots_.size(); }

 private:
  static std::size_t power_of_two(std::size_t least) {
    std::size_t size = 1;
    while (size < least) size *= 2;
    return size;
  }

  static constexpr std::size_t kCacheLine = 64;  // the two threads write to different lines

  std::vector<T> slots_;
  std::uint64_t mask_;
  alignas(kCacheLine) std::atomic<std::uint64_t> head_{0};  // next to write; the writer's
  alignas(kCacheLine) std::atomic<std::uint64_t> tail_{0};  // next to read; the reader's
  alignas(kCacheLine) std::atomic<std::uint64_t> drops_{0};
};

}  // namespace servotwin::daemon
