// Real CAN sockets: round trips, stamps, FD, filters, drop counts, interfaces that go and come.
#include "drivers/can/socketcan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <time.h>

#include <chrono>
#include <thread>

#include "tests/support/expect_error.h"
#include "tests/vcan/support.h"

namespace servotwin {
namespace {

using test::expect_error;
using test::frame_of;
using test::ip;
using test::received;

std::int64_t wall_ns() {
  timespec now{};
  clock_gettime(CLOCK_REALTIME, &now);
  return static_cast<std::int64_t>(now.tv_sec) * 1'000'000'000 + now.tv_nsec;
}

TEST(SocketCan, ARoundTripHasTheKernelsStamp) {
  SocketCan from("vcan0"), to("vcan0");
  const std::vector frames{frame_of(0x123, {1, 2, 3}), frame_of(0x1F334455, {4}),
                           frame_of(0x80, {})};
  const std::int64_t before = wall_ns();
  ASSERT_EQ(from.send(frames), 3U);
  const auto came = received(to);
  const std::int64_t after = wall_ns();
  ASSERT_EQ(came.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_EQ(came[i].id, frames[i].id);
    EXPECT_EQ(came[i].extended, frames[i].extended);
    EXPECT_EQ(came[i].length, frames[i].length);
    EXPECT_EQ(came[i].data, frames[i].data);
    EXPECT_GE(came[i].time_ns, before);
    EXPECT_LE(came[i].time_ns, after);
  }
  EXPECT_TRUE(received(from, 0.01).empty()) << "a sender does not hear itself";
}

TEST(SocketCan, StampsTellWhenAFrameCameAndNotWhenItWasRead) {
  SocketCan from("vcan0"), to("vcan0");
  ASSERT_EQ(from.send(std::vector{frame_of(1, {})}), 1U);
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  const std::int64_t read = wall_ns();
  const auto came = received(to);
  ASSERT_EQ(came.size(), 1U);
  EXPECT_GT(read - came[0].time_ns, 150'000'000);
}

TEST(SocketCan, RemoteFramesAndFd) {
  SocketCan from("vcan0"), to("vcan0");
  CanFrame remote = frame_of(0x222, {});
  remote.remote = true;
  remote.length = 4;
  CanFrame fd = frame_of(0x333, {});
  fd.fd = fd.fast = true;
  fd.length = 64;
  for (std::size_t i = 0; i < 64; ++i) fd.data[i] = static_cast<std::uint8_t>(i);
  ASSERT_EQ(from.send(std::vector{remote, fd}), 2U);
  const auto came = received(to);
  ASSERT_EQ(came.size(), 2U);
  EXPECT_TRUE(came[0].remote);
  EXPECT_EQ(came[0].length, 4);
  EXPECT_TRUE(came[1].fd && came[1].fast && !came[1].passive);
  EXPECT_EQ(came[1].length, 64);
  EXPECT_EQ(came[1].data, fd.data);
}

TEST(SocketCan, AFilterLetsOnlyItsIdsThrough) {
  SocketCan from("vcan0");
  SocketCanOptions options;
  options.only = {{0x181, false}, {0x181, true}};
  SocketCan to("vcan0", options);
  CanFrame extended = frame_of(0x181, {2});
  extended.extended = true;
  ASSERT_EQ(from.send(std::vector{frame_of(0x181, {1}), frame_of(0x182, {1}), extended,
                                  frame_of(0x12345181, {1})}),
            4U);
  const auto came = received(to);
  ASSERT_EQ(came.size(), 2U);
  EXPECT_FALSE(came[0].extended);
  EXPECT_TRUE(came[1].extended);
}

TEST(SocketCan, FramesThatAreNotTakenInTimeAreCounted) {
  SocketCan from("vcan0");
  SocketCanOptions options;
  options.receive_buffer_bytes = 4096;  // the kernel makes it a little more
  SocketCan to("vcan0", options);
  constexpr std::uint64_t kSent = 2000;
  for (std::uint64_t i = 0; i < kSent; ++i) {
    while (from.send(std::vector{frame_of(1, {1, 2, 3, 4, 5, 6, 7, 8})}) == 0)
      std::this_thread::sleep_for(std::chrono::microseconds(100));
  }
  const std::size_t kept = received(to).size();
  EXPECT_LT(kept, kSent / 2);
  // The count comes with the next frame that finds room.
  ASSERT_EQ(from.send(std::vector{frame_of(2, {})}), 1U);
  const auto next = received(to);
  ASSERT_EQ(next.size(), 1U);
  EXPECT_TRUE(next[0].after_gap);
  EXPECT_EQ(to.counts().dropped + kept, kSent);
}

TEST(SocketCan, GoesOnWhenItsInterfaceWentDownAndUp) {
  SocketCan from("vcan1"), to("vcan1");
  ip("link set vcan1 down");
  EXPECT_TRUE(received(to, 0.3).empty());
  EXPECT_EQ(to.counts().downs, 1U);
  EXPECT_FALSE(to.counts().up);
  EXPECT_EQ(from.send(std::vector{frame_of(1, {})}), 0U);
  EXPECT_EQ(from.counts().not_sent, 1U);
  ip("link set vcan1 up");
  EXPECT_TRUE(received(to, 0.3).empty());
  EXPECT_TRUE(to.counts().up);
  ASSERT_EQ(from.send(std::vector{frame_of(2, {})}), 1U);
  EXPECT_EQ(received(to).size(), 1U);
  EXPECT_EQ(to.counts().downs, 1U);
}

TEST(SocketCan, GoesOnWhenItsInterfaceWentAwayAndCameBack) {
  SocketCan to("vcan1");
  ip("link delete vcan1");
  EXPECT_TRUE(received(to, 0.3).empty());
  EXPECT_FALSE(to.counts().up);
  ip("link add vcan1 type vcan");
  ip("link set vcan1 mtu 72 up");
  EXPECT_TRUE(received(to, 0.3).empty());
  SocketCan from("vcan1");
  ASSERT_EQ(from.send(std::vector{frame_of(2, {})}), 1U);
  EXPECT_EQ(received(to).size(), 1U);
  EXPECT_TRUE(to.counts().up);
  EXPECT_EQ(to.counts().downs, 1U);
}

TEST(SocketCan, WithoutAnInterfaceItSaysSo) {
  expect_error<std::runtime_error>([] { SocketCan bus("can99"); },
                                   {"can99", "no such CAN interface"});
}

}  // namespace
}  // namespace servotwin
