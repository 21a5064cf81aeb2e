#include <gtest/gtest.h>

#include <array>
#include <thread>

#include "daemon/between/latest_value.h"
#include "daemon/between/ring.h"

namespace servotwin::daemon {
namespace {

/// Large enough for torn reads; every part identifies the value to which it belongs.
struct Value {
  std::array<std::uint64_t, 32> parts{};

  static Value of(std::uint64_t n) {
    Value value;
    for (std::size_t i = 0; i < value.parts.size(); ++i) value.parts[i] = n * (i + 1);
    return value;
  }
  [[nodiscard]] std::uint64_t number() const { return parts[0]; }
  [[nodiscard]] bool whole() const {
    for (std::size_t i = 0; i < parts.size(); ++i) {
      if (parts[i] != parts[0] * (i + 1)) return false;
    }
    return true;
  }
};

TEST(LatestValue, HasNothingFreshBeforeTheFirstAndAfterTheLast) {
  LatestValue<Value> latest;
  EXPECT_EQ(latest.fresh(), nullptr);
  latest.publish(Value::of(1));
  ASSERT_NE(latest.fresh(), nullptr);
  EXPECT_EQ(latest.fresh(), nullptr);
}

TEST(LatestValue, TheNewestWins) {
  LatestValue<Value> latest;
  for (std::uint64_t n = 1; n <= 5; ++n) latest.publish(Value::of(n));
  const Value* value = latest.fresh();
  ASSERT_NE(value, nullptr);
  EXPECT_EQ(value->number(), 5U);
}

/// The same with two slots, which is not enough: kept to show that the test below can fail.
template <class T>
class TwoSlots {
 public:
  void publish(const T& value) noexcept {
    const std::uint8_t back = 1 - newest_.load(std::memory_order_acquire);
    slots_[back] = value;
    newest_.store(back, std::memory_order_release);
    fresh_.store(true, std::memory_order_release);
  }
  const T* fresh() noexcept {
    if (!fresh_.exchange(false, std::memory_order_acq_rel)) return nullptr;
    return &slots_[newest_.load(std::memory_order_acquire)];
  }

 private:
  std::array<T, 2> slots_{};
  std::atomic<std::uint8_t> newest_{0};
  std::atomic<bool> fresh_{false};
};

/// Whether the value of the reader stays unchanged while the writer continues.
template <class Latest>
bool stays() {
  Latest latest;
  latest.publish(Value::of(1));
  const Value* held = latest.fresh();
  if (held == nullptr) return false;
  for (std::uint64_t n = 2; n < 12; ++n) {
    latest.publish(Value::of(n));
    if (held->number() != 1 || !held->whole()) return false;
  }
  return true;
}

TEST(LatestValue, WhatTheReaderHoldsDoesNotChange) {
  EXPECT_TRUE(stays<LatestValue<Value>>());
  EXPECT_FALSE(stays<TwoSlots<Value>>()) << "this test does not see what it is made for";
}

TEST(LatestValue, BetweenThreadsValuesAreWholeRiseAndTheLastArrives) {
  constexpr std::uint64_t kLast = 300'000;
  LatestValue<Value> latest;
  std::jthread writer([&] {
    for (std::uint64_t n = 1; n <= kLast; ++n) latest.publish(Value::of(n));
  });
  std::uint64_t before = 0;
  while (before < kLast) {
    const Value* value = latest.fresh();
    if (value == nullptr) continue;
    ASSERT_TRUE(value->whole());
    ASSERT_GT(value->number(), before);
    before = value->number();
  }
}

TEST(Ring, GivesBackInOrder) {
  Ring<Value> ring(8);
  Value value;
  EXPECT_FALSE(ring.pop(value));
  for (std::uint64_t round = 0; round < 5; ++round) {  // several times round
    for (std::uint64_t n = 1; n <= 6; ++n) EXPECT_TRUE(ring.push(Value::of(n)));
    EXPECT_EQ(ring.waiting(), 6U);
    for (std::uint64_t n = 1; n <= 6; ++n) {
      ASSERT_TRUE(ring.pop(value));
      EXPECT_EQ(value.number(), n);
    }
  }
  EXPECT_EQ(ring.drops(), 0U);
}

TEST(Ring, FullDropsTheNewOneAndCounts) {
  Ring<Value> ring(4);
  for (std::uint64_t n = 1; n <= 7; ++n) EXPECT_EQ(ring.push(Value::of(n)), n <= 4);
  EXPECT_EQ(ring.drops(), 3U);
  Value value;
  for (std::uint64_t n = 1; n <= 4; ++n) {
    ASSERT_TRUE(ring.pop(value));
    EXPECT_EQ(value.number(), n);
  }
  EXPECT_FALSE(ring.pop(value));
}

TEST(Ring, HasRoomForAtLeastWhatWasAskedFor) {
  for (const std::size_t asked : {1U, 2U, 3U, 5U, 8U, 100U}) {
    Ring<int> ring(asked);
    EXPECT_GE(ring.capacity(), asked);
    EXPECT_LT(ring.capacity(), 2 * asked + 1);
  }
}

TEST(Ring, BetweenThreadsEveryValueIsReceivedInOrderOrCounted) {
  constexpr std::uint64_t kLast = 300'000;
  Ring<Value> ring(64);
  std::atomic<bool> done{false};
  std::jthread writer([&] {
    for (std::uint64_t n = 1; n <= kLast; ++n) ring.push(Value::of(n));
    done.store(true, std::memory_order_release);
  });
  std::uint64_t received = 0, before = 0;
  Value value;
  while (true) {
    const bool last_look = done.load(std::memory_order_acquire);
    while (ring.pop(value)) {
      ASSERT_TRUE(value.whole());
      ASSERT_GT(value.number(), before);
      before = value.number();
      ++received;
    }
    if (last_look) break;
  }
  EXPECT_GT(received, 0U);
  EXPECT_EQ(received + ring.drops(), kLast);
}

}  // namespace
}  // namespace servotwin::daemon
