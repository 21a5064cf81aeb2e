// The address on which the daemon answers HTTP: "127.0.0.1:8402", "[::1]:8402", or "0.0.0.0:8402"
// for all interfaces.
//
// Numeric addresses only: a name would be looked up at every start. Port 0: any free port. Any
// thread; errors: none.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace servotwin::daemon {

struct ListenAddress {
  std::string host;  ///< IPv4 or IPv6, without brackets
  std::uint16_t port = 0;
  bool ipv6 = false;

  /// "127.0.0.1:8402", "[::1]:8402"
  [[nodiscard]] std::string text() const;
  /// Whether only this host can reach it.
  [[nodiscard]] bool is_loopback() const;
};

/// Nothing if the text is not such an address.
[[nodiscard]] std::optional<ListenAddress> parse_listen_address(std::string_view text);

/// The error message for a text that is not such an address.
inline constexpr const char* kListenRule =
    "must be ADDRESS:PORT, such as '127.0.0.1:8402', '[::1]:8402' or, for everybody on the "
    "network, '0.0.0.0:8402'; or 'none'";

/// The default address of the page.
inline constexpr const char* kDefaultListen = "127.0.0.1:8402";

}  // namespace servotwin::daemon
