#include "daemon/config/listen_address.h"

#include <arpa/inet.h>

#include <charconv>

namespace servotwin::daemon {

std::string ListenAddress::text() const {
  return (ipv6 ? "[" + host + "]" : host) + ":" + std::to_string(port);
}

bool ListenAddress::is_loopback() const {
  in6_addr six{};
  if (ipv6) return inet_pton(AF_INET6, host.c_str(), &six) == 1 && IN6_IS_ADDR_LOOPBACK(&six);
  return host.starts_with("127.");
}

std::optional<ListenAddress> parse_listen_address(std::string_view text) {
  const std::size_t colon = text.rfind(':');
  if (colon == text.npos) return std::nullopt;
  std::string_view host = text.substr(0, colon);
  const std::string_view port = text.substr(colon + 1);
  ListenAddress out;
  const auto read = std::from_chars(port.data(), port.data() + port.size(), out.port);
  if (port.empty() || read.ec != std::errc{} || read.ptr != port.data() + port.size())
    return std::nullopt;
  out.ipv6 = host.size() > 2 && host.front() == '[' && host.back() == ']';
  if (out.ipv6) host = host.substr(1, host.size() - 2);
  out.host = host;
  unsigned char bytes[sizeof(in6_addr)];
  if (inet_pton(out.ipv6 ? AF_INET6 : AF_INET, out.host.c_str(), bytes) != 1) return std::nullopt;
  return out;
}

}  // namespace servotwin::daemon
