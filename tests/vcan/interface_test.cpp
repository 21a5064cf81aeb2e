// The ground that the other tests stand on: the interfaces are real ones of the kernel, and what
// the can-utils send and see is what a socket of ours sees and sends.
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <cstring>
#include <string>

namespace servotwin {
namespace {

using testing::ElementsAreArray;
using testing::HasSubstr;

class RawSocket {
 public:
  explicit RawSocket(const char* interface) : socket_(::socket(PF_CAN, SOCK_RAW, CAN_RAW)) {
    const int on = 1;
    EXPECT_EQ(setsockopt(socket_, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, &on, sizeof on), 0);
    sockaddr_can address{};
    address.can_family = AF_CAN;
    address.can_ifindex = static_cast<int>(if_nametoindex(interface));
    EXPECT_GT(address.can_ifindex, 0) << interface << " is not there: run these by tests/vcan/run";
    EXPECT_EQ(bind(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  RawSocket(const RawSocket&) = delete;
  RawSocket& operator=(const RawSocket&) = delete;
  ~RawSocket() { close(socket_); }

  void send(const canfd_frame& frame, std::size_t size) const {
    EXPECT_EQ(write(socket_, &frame, size), static_cast<ssize_t>(size));
  }
  /// Its size, which tells a classic frame from one of CAN FD; 0: none within ten seconds.
  std::size_t receive(canfd_frame& frame) const {
    pollfd waiting{socket_, POLLIN, 0};
    if (poll(&waiting, 1, 10'000) <= 0) return 0;
    const ssize_t size = read(socket_, &frame, sizeof frame);
    return size > 0 ? static_cast<std::size_t>(size) : 0;
  }

 private:
  int socket_;
};

int shell(const std::string& command) { return std::system(command.c_str()); }

TEST(VirtualCan, AFrameOfCansendArrivesAsItIs) {
  const RawSocket socket("vcan0");
  ASSERT_EQ(shell("cansend vcan0 181#1122334455667788"), 0);
  canfd_frame frame{};
  ASSERT_EQ(socket.receive(frame), sizeof(can_frame));
  EXPECT_EQ(frame.can_id, 0x181U);
  ASSERT_EQ(frame.len, 8);
  EXPECT_THAT(std::vector<int>(frame.data, frame.data + 8),
              ElementsAreArray({0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88}));
}

TEST(VirtualCan, AnFdFrameOf64BytesArrivesWhole) {
  const RawSocket sender("vcan0"), receiver("vcan0");
  canfd_frame sent{};
  sent.can_id = 0x123;
  sent.len = 64;
  sent.flags = CANFD_BRS;
  for (int i = 0; i < 64; ++i) sent.data[i] = static_cast<std::uint8_t>(3 * i + 1);
  sender.send(sent, sizeof sent);
  canfd_frame came{};
  ASSERT_EQ(receiver.receive(came), sizeof(canfd_frame));
  EXPECT_EQ(came.can_id, sent.can_id);
  EXPECT_EQ(came.len, 64);
  EXPECT_EQ(std::memcmp(came.data, sent.data, 64), 0);
}

TEST(VirtualCan, CandumpSeesWhatASocketSends) {
  // -n 1: it ends with the first frame; -T: or after ten seconds without any.
  FILE* candump = popen("candump -L -n 1 -T 10000 vcan1 & sleep 0.3; echo listening; wait", "r");
  ASSERT_NE(candump, nullptr);
  std::array<char, 256> line{};
  ASSERT_NE(std::fgets(line.data(), line.size(), candump), nullptr);
  EXPECT_STREQ(line.data(), "listening\n");
  const RawSocket socket("vcan1");
  canfd_frame frame{};
  frame.can_id = 0x7FF;
  frame.len = 2;
  frame.data[0] = 0xAB;
  frame.data[1] = 0xCD;
  socket.send(frame, sizeof(can_frame));
  ASSERT_NE(std::fgets(line.data(), line.size(), candump), nullptr);
  EXPECT_THAT(line.data(), HasSubstr("vcan1 7FF#ABCD"));
  EXPECT_EQ(pclose(candump), 0);
}

TEST(VirtualCan, InterfacesAreApart) {
  const RawSocket first("vcan0"), second("vcan1");
  ASSERT_EQ(shell("cansend vcan1 001#01 && cansend vcan0 002#02"), 0);
  canfd_frame frame{};
  ASSERT_GT(first.receive(frame), 0U);
  EXPECT_EQ(frame.can_id, 2U) << "what was sent before on the other interface came here";
}

}  // namespace
}  // namespace servotwin
