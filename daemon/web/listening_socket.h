// A TCP socket that listens on an address. Any thread; errors: see each function.
#pragma once

#include <cstdint>
#include <string>

#include "daemon/config/listen_address.h"

namespace servotwin::daemon {

/// A non-blocking socket, which the caller closes, and its `port` where that of the address is 0.
/// Negative, with errno, if the address cannot be used now.
[[nodiscard]] int listening_socket(const ListenAddress& address, std::uint16_t& port);

/// The errno of listening_socket() and what to do, as the end of a sentence; `option`: the one that
/// gives another address.
[[nodiscard]] std::string listening_problem(int error, const std::string& option);

}  // namespace servotwin::daemon
