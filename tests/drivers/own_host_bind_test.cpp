// Which addresses the sockets of DDS have: the kernel's own list of them.
#include "drivers/dds/own_host_bind.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <set>

#include "drivers/dds/dds.h"
#include "tests/drivers/dds_place.h"

namespace servotwin {
namespace {

/// The local addresses of the bound UDP sockets of this process.
std::multiset<std::string> udp_addresses() {
  std::multiset<std::string> out;
  for (const auto& entry : std::filesystem::directory_iterator("/proc/self/fd")) {
    const int socket = std::stoi(entry.path().filename());
    int type = 0;
    socklen_t size = sizeof type;
    if (getsockopt(socket, SOL_SOCKET, SO_TYPE, &type, &size) != 0 || type != SOCK_DGRAM) continue;
    sockaddr_in own{};
    size = sizeof own;
    if (getsockname(socket, reinterpret_cast<sockaddr*>(&own), &size) != 0) continue;
    if (own.sin_family != AF_INET || own.sin_port == 0) continue;
    char text[INET_ADDRSTRLEN];
    out.insert(inet_ntop(AF_INET, &own.sin_addr, text, sizeof text));
  }
  return out;
}

TEST(OwnHostBind, NoOtherHostReachesDdsUnlessItIsConfigured) {
  const DdsNode node(place("own-host"));
  const std::multiset<std::string> addresses = udp_addresses();
  EXPECT_GE(addresses.size(), 2U) << "discovery and data";
  EXPECT_EQ(addresses.count("127.0.0.1"), addresses.size())
      << "all others: " << *addresses.begin() << " " << *addresses.rbegin();
}

TEST(OwnHostBind, LeavesOtherSocketsAlone) {
  const auto bound = [](const char* address) {
    const int socket = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    sockaddr_in own{};
    own.sin_family = AF_INET;
    inet_pton(AF_INET, address, &own.sin_addr);
    EXPECT_EQ(bind(socket, reinterpret_cast<const sockaddr*>(&own), sizeof own), 0) << address;
    socklen_t size = sizeof own;
    getsockname(socket, reinterpret_cast<sockaddr*>(&own), &size);
    close(socket);
    return ntohl(own.sin_addr.s_addr);
  };
  {
    const OwnHostBind own_host;
    EXPECT_EQ(bound("0.0.0.0"), INADDR_LOOPBACK);
    EXPECT_EQ(bound("127.0.0.2"), INADDR_LOOPBACK + 1);
  }
  EXPECT_EQ(bound("0.0.0.0"), INADDR_ANY);
}

}  // namespace
}  // namespace servotwin
