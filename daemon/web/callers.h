// Who is connected to the HTTP server, and which connection has to go: so that somebody with the
// token gets through, however many connections others hold open.
//
// A new connection is always accepted. Where there are too many, the one that is least likely to be
// wanted is dropped for it (surplus); what takes too long is dropped in any case (is_overdue). Live
// streams are limited by their own number and do not take places of others. An address is one IPv4
// address or one IPv6 network (/64), because a host has as many IPv6 addresses as it likes.
//
// Times: steady clock [ns]. One thread; errors: none.
#pragma once

#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <string>

#include "daemon/web/http_message.h"

struct MHD_Connection;
struct sockaddr;

namespace servotwin::daemon {

struct Caller {
  enum class Phase : std::uint8_t {
    kRequest,  ///< its next request is not complete
    kBody,     ///< the body of its request is being received
    kHeld,     ///< the answer to its request is delayed
    kAnswer,   ///< it is being answered
    kStream,   ///< it reads the live stream
  };
  MHD_Connection* connection = nullptr;
  std::string address;  ///< "192.168.7.9", "2001:db8:0:1::/64"
  bool local = false;   ///< on this host
  Phase phase = Phase::kRequest;
  std::int64_t hold_ns = 0;           ///< in kHeld: for how long; 0: until others have been served
  std::shared_ptr<std::string> body;  ///< what has come of it; null: none is expected
  LaterResponse later;                ///< valid: in kHeld until it is ready
  std::int64_t since_ns = 0;  ///< begin of the phase; of a stream, when it last took something
  bool dropped = false;       ///< its connection is being closed
  bool suspended = false;     ///< nothing is read from it or sent to it
  std::uint64_t next = 0;     ///< message of the live stream
  std::size_t offset = 0;     ///< in it

  void enter(Phase next_phase, std::int64_t now_ns) {
    phase = next_phase;
    since_ns = now_ns;
  }
};

/// Sets address and local. `from`: IPv4 or IPv6.
void set_address(Caller& caller, const sockaddr& from);

class Callers {
 public:
  static constexpr int kMaxConnections = 64;  ///< connections without the live streams
  static constexpr int kMaxPerAddress = 48;
  static constexpr unsigned kMaxStreams = 16;
  /// From the begin of a connection, or from the end of its last answer, to the end of the next
  /// request: a whole header, however slowly its bytes come.
  static constexpr std::int64_t kRequest_ns = 10'000'000'000;
  /// For the whole body, which somebody with the token sends: 64 MB at 4.3 Mbit/s.
  static constexpr std::int64_t kBody_ns = 120'000'000'000;
  /// For the whole answer: a megabyte at 0.3 Mbit/s.
  static constexpr std::int64_t kAnswer_ns = 30'000'000'000;
  /// A stream that takes nothing for that long although there is something.
  static constexpr std::int64_t kStalledStream_ns = 10'000'000'000;

  /// The reference stays valid until close().
  Caller& open(MHD_Connection* connection, std::int64_t now_ns);
  void close(const Caller& caller);

  [[nodiscard]] std::size_t streams() const { return count(Caller::Phase::kStream); }
  /// The connections in this phase that are not being closed.
  [[nodiscard]] std::size_t count(Caller::Phase phase) const;
  /// A connection that has to go because there are too many; null: there are not. The order: those
  /// of other hosts first; of the address that has the most; without a complete request; the one
  /// that has been so for the longest time. The newest is therefore the last.
  [[nodiscard]] Caller* surplus();
  [[nodiscard]] static bool is_overdue(const Caller& caller, std::int64_t now_ns);

  auto begin() { return callers_.begin(); }
  auto end() { return callers_.end(); }

 private:
  std::list<Caller> callers_;
};

}  // namespace servotwin::daemon
