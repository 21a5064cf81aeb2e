// Where the daemon is asked over HTTP: "127.0.0.1:8402", "[::1]:8402", "0.0.0.0:8402" for
// everybody.
//
// Numbers only: a name would be looked up at every start. Port 0: any that is free. Any thread.
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
};

/// Nothing if it is none.
[[nodiscard]] std::optional<ListenAddress> parse_listen_address(std::string_view text);

/// What a message says of an address that is none.
inline constexpr const char* kListenRule =
    "must be ADDRESS:PORT, such as '127.0.0.1:8402', '[::1]:8402' or, for everybody on the "
    "network, '0.0.0.0:8402'; or 'none'";

/// Where the page is looked for, unless told otherwise.
inline constexpr const char* kDefaultListen = "127.0.0.1:8402";

}  // namespace servotwin::daemon
