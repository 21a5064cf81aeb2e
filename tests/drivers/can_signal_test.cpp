// Bits to numbers: closed forms by hand, round trips over all places, and the DBC numbering of
// bits.
#include "drivers/can/can_signal.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace servotwin {
namespace {

constexpr std::array<std::uint8_t, 8> kData{0x12, 0x34, 0x56, 0x78, 0x9A, 0xBC, 0xDE, 0xF0};

TEST(CanSignal, LittleEndianTakesTheLowestByteFirst) {
  EXPECT_EQ(raw_bits({0, 16, ByteOrder::kLittle}, kData), 0x3412U);
  EXPECT_EQ(raw_bits({4, 8, ByteOrder::kLittle}, kData), 0x41U);
  EXPECT_EQ(raw_bits({0, 64, ByteOrder::kLittle}, kData), 0xF0DEBC9A78563412U);
  EXPECT_EQ(raw_bits({63, 1, ByteOrder::kLittle}, kData), 1U);
}

TEST(CanSignal, BigEndianStartsAtItsHighestBit) {
  // DBC: bit 7 of byte 0 is bit 7; a signal goes on at bit 7 of the next byte, which is bit 15.
  EXPECT_EQ(raw_bits({7, 16, ByteOrder::kBig}, kData), 0x1234U);
  EXPECT_EQ(raw_bits({3, 8, ByteOrder::kBig}, kData), 0x23U);
  EXPECT_EQ(raw_bits({7, 64, ByteOrder::kBig}, kData), 0x123456789ABCDEF0U);
  EXPECT_EQ(raw_bits({0, 1, ByteOrder::kBig}, kData), 0U);
}

TEST(CanSignal, SignsFloatsScaleAndOffset) {
  const std::array<std::uint8_t, 8> minus{0xFE, 0xFF, 0, 0, 0x00, 0x00, 0xC0, 0x3F};
  EXPECT_EQ(decoded({0, 16, ByteOrder::kLittle, Coding::kSigned, 0.5, 10.0}, minus), 9.0);
  EXPECT_EQ(decoded({0, 16, ByteOrder::kLittle, Coding::kUnsigned}, minus), 65534.0);
  EXPECT_EQ(decoded({32, 32, ByteOrder::kLittle, Coding::kFloat, 2.0, 0.0}, minus), 3.0);
  EXPECT_EQ(raw_integer({0, 4, ByteOrder::kLittle, Coding::kSigned}, 0x8), -8);
}

TEST(CanSignal, WhatCannotBeIsNone) {
  EXPECT_EQ(bytes_needed({0, 0}), 0);
  EXPECT_EQ(bytes_needed({0, 65}), 0);
  EXPECT_EQ(bytes_needed({-1, 8}), 0);
  EXPECT_EQ(bytes_needed({512, 1}), 0);
  EXPECT_EQ(bytes_needed({505, 8}), 0);  // one bit too far
  EXPECT_EQ(bytes_needed({504, 8}), 64);
  EXPECT_EQ(bytes_needed({0, 16, ByteOrder::kLittle, Coding::kFloat}), 0);
  EXPECT_EQ(bytes_needed({0, 10, ByteOrder::kBig}), 3);  // one bit of byte 0, eight of byte 1, one
  EXPECT_EQ(bytes_needed({7, 9, ByteOrder::kBig}), 2);
}

/// The bit that comes after `bit` in a signal, by the rule of the DBC format.
int following(int bit, ByteOrder order) {
  if (order == ByteOrder::kLittle) return bit + 1;
  return bit % 8 == 0 ? bit + 15 : bit - 1;
}

TEST(CanSignal, EveryPlaceReadsWhatWasWrittenAndTouchesNothingElse) {
  std::mt19937_64 random(7);
  for (const ByteOrder order : {ByteOrder::kLittle, ByteOrder::kBig}) {
    for (int start = 0; start < 64; ++start) {
      for (int length = 1; length <= 64; ++length) {
        const CanSignal signal{start, length, order};
        const int bytes = bytes_needed(signal);
        if (bytes == 0 || bytes > 16) continue;
        std::array<std::uint8_t, 16> data{};
        for (auto& byte : data) byte = static_cast<std::uint8_t>(random());
        const auto before = data;
        const std::uint64_t raw = random() >> (64 - length);
        set_raw_bits(signal, raw, data);
        ASSERT_EQ(raw_bits(signal, data), raw) << start << " " << length;
        // Bit by bit, by the other route.
        std::vector<bool> ours(128);
        int bit = start;
        for (int i = 0; i < length; ++i) {
          ours[static_cast<std::size_t>(bit)] = true;
          const int weight = order == ByteOrder::kLittle ? i : length - 1 - i;
          const auto byte = static_cast<std::size_t>(bit) / 8;
          ASSERT_EQ(data[byte] >> (bit % 8) & 1, static_cast<int>(raw >> weight & 1));
          bit = following(bit, order);
        }
        for (std::size_t i = 0; i < 128; ++i) {
          if (ours[i]) continue;
          ASSERT_EQ(data[i / 8] >> (i % 8) & 1, before[i / 8] >> (i % 8) & 1);
        }
      }
    }
  }
}

TEST(CanSignal, EncodesToTheNearestAndRefusesWhatDoesNotFit) {
  const CanSignal byte{0, 8, ByteOrder::kLittle, Coding::kSigned, 0.1, 1.0};
  std::uint64_t raw = 99;
  EXPECT_TRUE(encoded(byte, 0.46, false, raw));
  EXPECT_EQ(raw, 0xFBU);  // (0.46 - 1) / 0.1 = -5.4
  EXPECT_TRUE(encoded(byte, 1.0 + 12.7, false, raw));
  EXPECT_EQ(raw, 0x7FU);
  raw = 99;
  EXPECT_FALSE(encoded(byte, 1.0 + 12.8, false, raw));
  EXPECT_FALSE(encoded(byte, std::nan(""), false, raw));
  EXPECT_FALSE(encoded(byte, std::numeric_limits<double>::infinity(), true, raw));
  EXPECT_EQ(raw, 99U);
  EXPECT_TRUE(encoded(byte, 1.0 + 12.8, true, raw));  // goes round
  EXPECT_EQ(raw, 0x80U);
  EXPECT_FALSE(encoded({0, 8}, -1.0, false, raw));
  EXPECT_TRUE(encoded({0, 64, ByteOrder::kLittle, Coding::kFloat}, -1.5, false, raw));
  EXPECT_EQ(raw, 0xBFF8000000000000U);
}

}  // namespace
}  // namespace servotwin
