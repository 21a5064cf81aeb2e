#include "daemon/web/callers.h"

#include <arpa/inet.h>
#include <netinet/in.h>

#include <algorithm>
#include <cstring>
#include <map>
#include <string_view>
#include <tuple>

namespace servotwin::daemon {
namespace {

using Phase = Caller::Phase;

constexpr unsigned kLoopbackNet = 127;

/// Whether it takes one of the places that are limited here.
bool takes_a_place(const Caller& caller) {
  return !caller.dropped && caller.phase != Phase::kStream;
}

}  // namespace

void set_address(Caller& caller, const sockaddr& from) {
  char text[INET6_ADDRSTRLEN] = "";
  in_addr four{};
  if (from.sa_family == AF_INET6) {
    in6_addr six = reinterpret_cast<const sockaddr_in6&>(from).sin6_addr;
    if (!IN6_IS_ADDR_V4MAPPED(&six)) {
      caller.local = IN6_IS_ADDR_LOOPBACK(&six);
      std::memset(six.s6_addr + 8, 0, 8);
      caller.address = std::string(inet_ntop(AF_INET6, &six, text, sizeof text)) + "/64";
      return;
    }
    std::memcpy(&four, six.s6_addr + 12, sizeof four);
  } else {
    four = reinterpret_cast<const sockaddr_in&>(from).sin_addr;
  }
  caller.local = ntohl(four.s_addr) >> 24 == kLoopbackNet;
  caller.address = inet_ntop(AF_INET, &four, text, sizeof text);
}

Caller& Callers::open(MHD_Connection* connection, std::int64_t now_ns) {
  Caller& caller = callers_.emplace_back();
  caller.connection = connection;
  caller.since_ns = now_ns;
  return caller;
}

void Callers::close(const Caller& caller) {
  callers_.remove_if([&](const Caller& one) { return &one == &caller; });
}

std::size_t Callers::count(Phase phase) const {
  return static_cast<std::size_t>(std::count_if(
      callers_.begin(), callers_.end(),
      [phase](const Caller& caller) { return !caller.dropped && caller.phase == phase; }));
}

Caller* Callers::surplus() {
  std::map<std::string_view, int> of_address;
  int all = 0;
  for (const Caller& caller : callers_) {
    if (!takes_a_place(caller)) continue;
    ++of_address[caller.address];
    ++all;
  }
  const auto order = [&](const Caller& caller) {
    return std::tuple(caller.local, -of_address[caller.address], caller.phase != Phase::kRequest,
                      caller.since_ns);
  };
  Caller* first = nullptr;
  for (Caller& caller : callers_) {
    if (!takes_a_place(caller)) continue;
    if (all <= kMaxConnections && of_address[caller.address] <= kMaxPerAddress) continue;
    if (first == nullptr || order(caller) < order(*first)) first = &caller;
  }
  return first;
}

bool Callers::is_overdue(const Caller& caller, std::int64_t now_ns) {
  const std::int64_t passed_ns = now_ns - caller.since_ns;
  switch (caller.phase) {
    case Phase::kRequest:
      return passed_ns > kRequest_ns;
    case Phase::kBody:
      return passed_ns > kBody_ns;
    case Phase::kAnswer:
      return passed_ns > kAnswer_ns;
    case Phase::kStream:
      return !caller.suspended && passed_ns > kStalledStream_ns;
    case Phase::kHeld:
      return false;  // the server answers it
  }
  return false;
}

}  // namespace servotwin::daemon
