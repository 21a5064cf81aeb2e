// Sockets of Cyclone DDS on the loopback address only.
//
// Cyclone 0.10, which Debian 12 has, binds the sockets on which it receives to all addresses of the
// host, whatever interface it is told to use: packets of other hosts reach its parser. While an
// OwnHostBind lives, an IPv4 socket that this thread binds to all addresses is bound to 127.0.0.1
// instead. It is used around the creation of a domain. Errors: none. See docs/decisions/0012.
#pragma once

namespace servotwin {

class OwnHostBind {
 public:
  OwnHostBind() noexcept;
  OwnHostBind(const OwnHostBind&) = delete;
  OwnHostBind& operator=(const OwnHostBind&) = delete;
  ~OwnHostBind();
};

}  // namespace servotwin
