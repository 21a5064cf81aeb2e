#include "drivers/can/can_udp.h"

#include <netdb.h>
#include <netinet/in.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <stdexcept>
#include <system_error>
#include <utility>

#include "drivers/common/text.h"

namespace servotwin {
namespace {

constexpr int kReceiveBuffer = 8 << 20;
// A packet that is a little older than the last one was delayed on the network; one that is much
// older comes from a sender that has restarted.
constexpr int kMaxReordering_packets = 16;

bool is_loopback(const sockaddr_storage& address) noexcept {
  if (address.ss_family == AF_INET6)
    return IN6_IS_ADDR_LOOPBACK(&reinterpret_cast<const sockaddr_in6&>(address).sin6_addr);
  const in_addr_t host = ntohl(reinterpret_cast<const sockaddr_in&>(address).sin_addr.s_addr);
  return host >> 24 == IN_LOOPBACKNET;
}

}  // namespace

CanUdp::Address CanUdp::resolved(const std::string& place, bool ours) {
  const std::size_t colon = place.rfind(':');
  if (colon == std::string::npos || colon + 1 == place.size())
    throw std::runtime_error(in_quotes(place) + ": must be ADDRESS:PORT, such as 127.0.0.1:20000");
  const std::string digits = place.substr(colon + 1);
  if (digits.size() > 5 || digits.find_first_not_of("0123456789") != std::string::npos ||
      std::stoi(digits) > 65535) {
    throw std::runtime_error(in_quotes(place) + ": the port must be 0 to 65535");
  }
  std::string host = place.substr(0, colon);
  if (host.size() > 1 && host.front() == '[' && host.back() == ']')
    host = host.substr(1, host.size() - 2);
  addrinfo hints{};
  hints.ai_socktype = SOCK_DGRAM;
  hints.ai_flags = AI_NUMERICSERV | (ours ? AI_PASSIVE : 0);
  addrinfo* found = nullptr;
  const int error =
      getaddrinfo(host.empty() ? nullptr : host.c_str(), digits.c_str(), &hints, &found);
  if (error != 0)
    throw std::runtime_error(in_quotes(place) +
                             ": there is no such address: " + gai_strerror(error));
  Address address;
  std::memcpy(&address.storage, found->ai_addr, found->ai_addrlen);
  address.size = found->ai_addrlen;
  freeaddrinfo(found);
  return address;
}

void CanUdp::require_known_sender(const CanUdpPlace& place) {
  if (!place.peer.empty() || is_loopback(resolved(place.listen, true).storage)) return;
  throw std::runtime_error(
      in_quotes(place.listen) +
      ": other hosts reach this address, and frames of any sender would be accepted; give the "
      "sender as peer, HOST:PORT, or listen on 127.0.0.1");
}

CanUdp::CanUdp(const CanUdpPlace& place) : batch_(kPacketBytes) {
  require_known_sender(place);
  const Address own = resolved(place.listen, true);
  if (!place.peer.empty()) {
    peer_ = resolved(place.peer, false);
    has_peer_ = true;
    if (peer_.storage.ss_family != own.storage.ss_family) {
      throw std::runtime_error(in_quotes(place.listen) + " and " + in_quotes(place.peer) +
                               ": one is an IPv4 and one an IPv6 address");
    }
  }
  socket_ = ::socket(own.storage.ss_family, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  if (socket_ < 0 ||
      bind(socket_, reinterpret_cast<const sockaddr*>(&own.storage), own.size) != 0) {
    const std::string why = std::generic_category().message(errno);
    if (socket_ >= 0) ::close(socket_);
    throw std::runtime_error(in_quotes(place.listen) + ": cannot listen on this address: " + why);
  }
  SocketBatch::prepare(socket_, kReceiveBuffer);
}

CanUdp::~CanUdp() { ::close(socket_); }

int CanUdp::port() const noexcept {
  Address own;
  own.size = sizeof own.storage;
  if (getsockname(socket_, reinterpret_cast<sockaddr*>(&own.storage), &own.size) != 0) return 0;
  if (own.storage.ss_family == AF_INET6)
    return ntohs(reinterpret_cast<const sockaddr_in6&>(own.storage).sin6_port);
  return ntohs(reinterpret_cast<const sockaddr_in&>(own.storage).sin_port);
}

bool CanUdp::is_peer(const sockaddr_storage& from) const noexcept {
  if (!has_peer_) return true;
  if (from.ss_family != peer_.storage.ss_family) return false;
  if (from.ss_family == AF_INET6) {
    const auto& a = reinterpret_cast<const sockaddr_in6&>(from);
    const auto& b = reinterpret_cast<const sockaddr_in6&>(peer_.storage);
    return a.sin6_port == b.sin6_port &&
           std::memcmp(&a.sin6_addr, &b.sin6_addr, sizeof a.sin6_addr) == 0;
  }
  const auto& a = reinterpret_cast<const sockaddr_in&>(from);
  const auto& b = reinterpret_cast<const sockaddr_in&>(peer_.storage);
  return a.sin_port == b.sin_port && a.sin_addr.s_addr == b.sin_addr.s_addr;
}

bool CanUdp::open_packet() noexcept {
  const SocketBatch::Datagram datagram = batch_[next_++];
  if (datagram.has_dropped && datagram.dropped != dropped_) {
    count(counters_.dropped, datagram.dropped - dropped_);
    dropped_ = datagram.dropped;
  }
  packet_ = is_peer(*datagram.from)
                ? CannelloniPacket::parse({datagram.data, std::min(datagram.size, kPacketBytes)})
                : std::nullopt;
  if (!packet_) {
    count(counters_.malformed);
    return false;
  }
  packet_ns_ = datagram.time_ns;
  if (last_sequence_) {
    const auto ahead =
        static_cast<std::int8_t>(static_cast<std::uint8_t>(packet_->sequence() - *last_sequence_));
    if (ahead <= 0 && ahead > -kMaxReordering_packets) {
      count(counters_.malformed);
      packet_.reset();
      return false;
    }
    if (ahead != 1) {
      count(counters_.lost, ahead > 1 ? static_cast<std::uint64_t>(ahead) - 1 : 1);
      after_gap_ = true;
    }
  }
  last_sequence_ = packet_->sequence();
  return true;
}

std::size_t CanUdp::receive(std::span<CanFrame> batch, double timeout_s) noexcept {
  std::size_t frames = 0;
  if (!packet_ && next_ == came_) {
    if (timeout_s > 0.0) wait_readable(socket_, timeout_s);
    const int came = batch_.receive(socket_, SocketBatch::kMaxDatagrams);
    next_ = 0;
    came_ = came < 0 ? 0 : static_cast<std::size_t>(came);
  }
  while (frames < batch.size()) {
    if (!packet_) {
      if (next_ == came_) break;
      if (!open_packet()) continue;
    }
    CanFrame& frame = batch[frames];
    if (!packet_->next(frame)) {
      if (packet_->damaged()) count(counters_.malformed);
      packet_.reset();
      continue;
    }
    frame.time_ns = packet_ns_;
    frame.after_gap = std::exchange(after_gap_, false);
    ++frames;
  }
  count(counters_.received, frames);
  return frames;
}

std::size_t CanUdp::send(std::span<const CanFrame> frames) noexcept {
  std::size_t sent = 0;
  while (sent < frames.size() && has_peer_) {
    const CannelloniWritten written = write_cannelloni(frames.subspan(sent), sequence_, out_);
    if (written.frames == 0 || sendto(socket_, out_.data(), written.bytes, MSG_NOSIGNAL,
                                      reinterpret_cast<const sockaddr*>(&peer_.storage),
                                      peer_.size) != static_cast<ssize_t>(written.bytes)) {
      break;
    }
    ++sequence_;
    sent += written.frames;
  }
  count(counters_.sent, sent);
  count(counters_.not_sent, frames.size() - sent);
  return sent;
}

}  // namespace servotwin
