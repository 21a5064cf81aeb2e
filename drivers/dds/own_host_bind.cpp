#include "drivers/dds/own_host_bind.h"

#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <cstring>

namespace {

thread_local bool own_host_only = false;

}  // namespace

namespace servotwin {

OwnHostBind::OwnHostBind() noexcept { own_host_only = true; }
OwnHostBind::~OwnHostBind() { own_host_only = false; }

}  // namespace servotwin

/// Comes before the C library's for every program that links it, and for its libraries.
extern "C" int bind(int socket, const sockaddr* address, socklen_t size) noexcept {
  sockaddr_in own{};
  if (own_host_only && address != nullptr && address->sa_family == AF_INET && size >= sizeof own) {
    std::memcpy(&own, address, sizeof own);
    if (own.sin_addr.s_addr == htonl(INADDR_ANY)) own.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address = reinterpret_cast<const sockaddr*>(&own);
    size = sizeof own;
  }
  return static_cast<int>(syscall(SYS_bind, socket, address, size));
}
