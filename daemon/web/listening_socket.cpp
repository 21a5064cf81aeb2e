#include "daemon/web/listening_socket.h"

#include <arpa/inet.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

namespace servotwin::daemon {

int listening_socket(const ListenAddress& address, std::uint16_t& port) {
  sockaddr_in6 six{};
  sockaddr_in four{};
  six.sin6_family = AF_INET6;
  four.sin_family = AF_INET;
  six.sin6_port = four.sin_port = htons(address.port);
  inet_pton(address.ipv6 ? AF_INET6 : AF_INET, address.host.c_str(),
            address.ipv6 ? static_cast<void*>(&six.sin6_addr) : &four.sin_addr);
  auto* place =
      address.ipv6 ? reinterpret_cast<sockaddr*>(&six) : reinterpret_cast<sockaddr*>(&four);
  socklen_t length = address.ipv6 ? sizeof six : sizeof four;
  const int socket =
      ::socket(address.ipv6 ? AF_INET6 : AF_INET, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
  if (socket < 0) return -1;
  const int yes = 1;  // after a restart the old connections still linger
  setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
  if (bind(socket, place, length) != 0 || listen(socket, SOMAXCONN) != 0 ||
      getsockname(socket, place, &length) != 0) {
    const int error = errno;
    close(socket);
    errno = error;
    return -1;
  }
  port = ntohs(address.ipv6 ? six.sin6_port : four.sin_port);
  return socket;
}

std::string listening_problem(int error, const std::string& option) {
  std::string problem = std::strerror(error);
  switch (error) {
    case EADDRINUSE:
      return problem + "; give another address with " + option;
    case EADDRNOTAVAIL:
      return problem +
             "; this host has no such address: give one of its own, 0.0.0.0 for all of them or "
             "127.0.0.1 for this host alone";
    case EACCES:
      return problem + "; ports below 1024 need CAP_NET_BIND_SERVICE";
    default:
      return problem;
  }
}

}  // namespace servotwin::daemon
