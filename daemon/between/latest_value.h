// Hands the newest value from one thread to another: a newer value replaces the older one, and no
// thread waits.
//
// Three slots: the writer fills one, the reader holds one, the middle one changes hands with a
// single atomic exchange. One writer thread, one reader thread; all functions are wait-free and
// allocate nothing. The other hand-over between threads is daemon/between/ring.h; there is no
// third.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <type_traits>

namespace servotwin::daemon {

template <class T>
class LatestValue {
  static_assert(std::is_trivially_copyable_v<T>, "crosses threads by value");
  static_assert(std::atomic<std::uint8_t>::is_always_lock_free);

 public:
  /// Writer thread only.
  void publish(const T& value) noexcept {
    slots_[back_] = value;
    // release: pairs with the acquire in fresh(); makes slots_[back_] visible to the reader.
    // acquire: pairs with the release in fresh(); the reader is done with the slot that comes back.
    back_ = middle_.exchange(static_cast<std::uint8_t>(back_ | kFresh), std::memory_order_acq_rel) &
            kSlot;
  }

  /// Reader thread only: the newest value if one came since the last call, else null. What it
  /// points to does not change until the next call.
  [[nodiscard]] const T* fresh() noexcept {
    // relaxed: a cheap test only; the exchange below provides the ordering.
    if ((middle_.load(std::memory_order_relaxed) & kFresh) == 0) return nullptr;
    // acquire: pairs with the release in publish(); release: pairs with its acquire.
    front_ = middle_.exchange(front_, std::memory_order_acq_rel) & kSlot;
    return &slots_[front_];
  }

 private:
  static constexpr std::uint8_t kSlot = 3;
  static constexpr std::uint8_t kFresh = 4;

  std::array<T, 3> slots_{};
  std::uint8_t back_ = 0;                // writer's
  std::uint8_t front_ = 1;               // reader's
  std::atomic<std::uint8_t> middle_{2};  // the slot between them, and whether it is fresh
};

}  // namespace servotwin::daemon
