// CAN over UDP: the bytes of the format, damaged packets, and two buses on the loopback interface.
#include "drivers/can/cannelloni.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <unistd.h>

#include <vector>

#include "drivers/can/can_udp.h"
#include "tests/support/expect_error.h"

namespace servotwin {
namespace {

using test::expect_error;
using testing::ElementsAre;

CanFrame frame_of(std::uint32_t id, std::initializer_list<std::uint8_t> data) {
  CanFrame frame;
  frame.id = id;
  frame.extended = id >= kStandardIds;
  frame.length = static_cast<std::uint8_t>(data.size());
  std::copy(data.begin(), data.end(), frame.data.begin());
  return frame;
}

TEST(Cannelloni, TheBytesOfThePublishedFormat) {
  std::vector<CanFrame> frames{frame_of(0x123, {0xAA, 0xBB}), frame_of(0x1F334455, {0xCC})};
  frames.push_back(frame_of(0x7FF, {1}));
  frames.back().fd = frames.back().fast = true;
  frames.push_back(frame_of(0x10, {}));
  frames.back().remote = true;
  frames.back().length = 4;
  std::array<std::uint8_t, 100> packet{};
  const CannelloniWritten written = write_cannelloni(frames, 7, packet);
  EXPECT_EQ(written.frames, 4U);
  EXPECT_THAT(std::vector(packet.begin(), packet.begin() + written.bytes),
              ElementsAre(2, 0, 7, 0, 4,                    //
                          0, 0, 0x01, 0x23, 2, 0xAA, 0xBB,  //
                          0x9F, 0x33, 0x44, 0x55, 1, 0xCC,  //
                          0, 0, 0x07, 0xFF, 0x81, 0x01, 1,  //
                          0x40, 0, 0, 0x10, 4));
  auto read = CannelloniPacket::parse({packet.data(), written.bytes});
  ASSERT_TRUE(read);
  EXPECT_EQ(read->sequence(), 7);
  CanFrame frame;
  for (const CanFrame& wanted : frames) {
    ASSERT_TRUE(read->next(frame));
    EXPECT_EQ(frame.id, wanted.id);
    EXPECT_EQ(frame.extended, wanted.extended);
    EXPECT_EQ(frame.remote, wanted.remote);
    EXPECT_EQ(frame.fd, wanted.fd);
    EXPECT_EQ(frame.fast, wanted.fast);
    EXPECT_EQ(frame.length, wanted.length);
    EXPECT_EQ(frame.data, wanted.data);
  }
  EXPECT_FALSE(read->next(frame));
  EXPECT_FALSE(read->damaged());
}

TEST(Cannelloni, CutAnywhereItIsDamagedOrNone) {
  const std::vector<CanFrame> frames{frame_of(0x123, {1, 2, 3}), frame_of(0x124, {4, 5})};
  std::array<std::uint8_t, 100> packet{};
  const std::size_t whole = write_cannelloni(frames, 0, packet).bytes;
  for (std::size_t size = 0; size < whole; ++size) {
    auto read = CannelloniPacket::parse({packet.data(), size});
    if (size < 5) {
      EXPECT_FALSE(read);
      continue;
    }
    CanFrame frame;
    while (read->next(frame)) {
    }
    EXPECT_TRUE(read->damaged()) << size;
  }
}

TEST(Cannelloni, WritesOnlyWhatFits) {
  const std::vector<CanFrame> frames(10, frame_of(0x123, {1, 2, 3, 4, 5, 6, 7, 8}));
  std::array<std::uint8_t, 40> packet{};
  const CannelloniWritten written = write_cannelloni(frames, 0, packet);
  EXPECT_EQ(written.frames, 2U);
  EXPECT_EQ(written.bytes, 5U + 2U * 13U);
}

class UdpPair : public testing::Test {
 protected:
  CanUdp listener_{{"127.0.0.1:0", ""}};
  CanUdp sender_{{"127.0.0.1:0", "127.0.0.1:" + std::to_string(listener_.port())}};
  std::array<CanFrame, 64> batch_;
};

TEST_F(UdpPair, FramesComeInTheirOrderWithTheKernelsStamp) {
  std::vector<CanFrame> frames;
  for (std::uint32_t i = 0; i < 300; ++i) frames.push_back(frame_of(i, {1, 2, 3, 4, 5, 6, 7, 8}));
  ASSERT_EQ(sender_.send(frames), 300U);
  std::uint32_t next = 0;
  while (const std::size_t count = listener_.receive(batch_, 1.0)) {
    for (std::size_t i = 0; i < count; ++i, ++next) {
      ASSERT_EQ(batch_[i].id, next);
      EXPECT_GT(batch_[i].time_ns, 1'600'000'000'000'000'000);
      EXPECT_FALSE(batch_[i].after_gap);
    }
    if (next == 300) break;
  }
  EXPECT_EQ(next, 300U);
  EXPECT_EQ(listener_.counts().received, 300U);
  EXPECT_EQ(listener_.counts().lost, 0U);
  EXPECT_EQ(sender_.counts().sent, 300U);
}

TEST_F(UdpPair, NothingComesWhereNothingWasSent) { EXPECT_EQ(listener_.receive(batch_, 0.01), 0U); }

TEST_F(UdpPair, AStrangerIsNotListenedTo) {
  CanUdp picky({"127.0.0.1:0", "127.0.0.1:" + std::to_string(sender_.port())});
  CanUdp stranger({"127.0.0.1:0", "127.0.0.1:" + std::to_string(picky.port())});
  ASSERT_EQ(stranger.send(std::vector{frame_of(1, {1})}), 1U);
  EXPECT_EQ(picky.receive(batch_, 1.0), 0U);
  EXPECT_EQ(picky.counts().malformed, 1U);
}

TEST_F(UdpPair, WithoutAPeerNothingIsSent) {
  EXPECT_EQ(listener_.send(std::vector{frame_of(1, {1})}), 0U);
  EXPECT_EQ(listener_.counts().not_sent, 1U);
}

TEST(CanUdp, ALostPacketIsToldAndAnOldOneIsNotTaken) {
  CanUdp listener({"127.0.0.1:0", ""});
  const int socket = ::socket(AF_INET, SOCK_DGRAM, 0);
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  to.sin_port = htons(static_cast<std::uint16_t>(listener.port()));
  std::array<CanFrame, 8> batch;
  const auto came_after = [&](std::uint8_t sequence) {
    std::array<std::uint8_t, 64> packet{};
    const std::vector frames{frame_of(0x80, {})};
    const std::size_t bytes = write_cannelloni(frames, sequence, packet).bytes;
    EXPECT_EQ(sendto(socket, packet.data(), bytes, 0, reinterpret_cast<sockaddr*>(&to), sizeof to),
              static_cast<ssize_t>(bytes));
    return listener.receive(batch, 1.0);
  };
  EXPECT_EQ(came_after(254), 1U);
  EXPECT_EQ(came_after(255), 1U);
  EXPECT_FALSE(batch[0].after_gap);
  EXPECT_EQ(came_after(0), 1U);  // goes round
  EXPECT_FALSE(batch[0].after_gap);
  EXPECT_EQ(came_after(3), 1U);
  EXPECT_TRUE(batch[0].after_gap);
  EXPECT_EQ(listener.counts().lost, 2U);
  EXPECT_EQ(came_after(2), 0U);  // overtaken
  EXPECT_EQ(listener.counts().malformed, 1U);
  EXPECT_EQ(came_after(100), 1U);  // its sender started again
  EXPECT_TRUE(batch[0].after_gap);
  close(socket);
}

TEST(CanUdp, RefusesAddressesByName) {
  expect_error<std::runtime_error>(
      [] {
        CanUdp bus({"localhost", ""});
      },
      {"'localhost'", "ADDRESS:PORT"});
  expect_error<std::runtime_error>([] { CanUdp bus({"127.0.0.1:99999", ""}); }, {"99999"});
  expect_error<std::runtime_error>(
      [] {
        CanUdp bus({"192.0.2.1:1", "192.0.2.2:1"});
      },
      {"192.0.2.1:1", "cannot listen on this address"});
}

TEST(CanUdp, WithoutAPeerItListensToThisHostOnly) {
  for (const char* open : {"0.0.0.0:0", ":0", "[::]:0", "192.0.2.1:0"}) {
    expect_error<std::runtime_error>(
        [&] {
          CanUdp bus({open, ""});
        },
        {open, "other hosts reach this address", "give the sender"});
  }
  EXPECT_NO_THROW(CanUdp({"0.0.0.0:0", "127.0.0.1:20000"}));
  for (const char* own : {"127.0.0.1:0", "127.0.0.2:0", "[::1]:0"})
    EXPECT_NO_THROW(CanUdp({own, ""})) << own;
}

}  // namespace
}  // namespace servotwin
