#include "drivers/can/socket_batch.h"

#include <poll.h>
#include <time.h>

#include <algorithm>
#include <cmath>
#include <cstring>

namespace servotwin {

SocketBatch::SocketBatch(std::size_t bytes_each)
    : bytes_each_(bytes_each), data_(kMaxDatagrams * bytes_each), from_(kMaxDatagrams) {
  for (std::size_t i = 0; i < kMaxDatagrams; ++i) {
    vectors_[i] = {data_.data() + i * bytes_each_, bytes_each_};
    msghdr& header = headers_[i].msg_hdr;
    header.msg_iov = &vectors_[i];
    header.msg_iovlen = 1;
    header.msg_name = &from_[i];
  }
}

void SocketBatch::prepare(int socket, int receive_buffer_bytes) noexcept {
  const int on = 1;
  setsockopt(socket, SOL_SOCKET, SO_TIMESTAMPNS, &on, sizeof on);
  setsockopt(socket, SOL_SOCKET, SO_RXQ_OVFL, &on, sizeof on);
  // The first may exceed the system's limit and needs CAP_NET_ADMIN; the second is limited by it.
  if (setsockopt(socket, SOL_SOCKET, SO_RCVBUFFORCE, &receive_buffer_bytes,
                 sizeof receive_buffer_bytes) != 0) {
    setsockopt(socket, SOL_SOCKET, SO_RCVBUF, &receive_buffer_bytes, sizeof receive_buffer_bytes);
  }
}

int SocketBatch::receive(int socket, std::size_t most) noexcept {
  most = std::min(most, kMaxDatagrams);
  for (std::size_t i = 0; i < most; ++i) {
    msghdr& header = headers_[i].msg_hdr;
    header.msg_namelen = sizeof(sockaddr_storage);
    header.msg_control = control_[i].data();
    header.msg_controllen = kControl;
    header.msg_flags = 0;
  }
  return recvmmsg(socket, headers_.data(), static_cast<unsigned>(most), MSG_DONTWAIT, nullptr);
}

SocketBatch::Datagram SocketBatch::operator[](std::size_t i) noexcept {
  Datagram out;
  out.data = data_.data() + i * bytes_each_;
  out.size = headers_[i].msg_len;
  out.from = &from_[i];
  msghdr& header = headers_[i].msg_hdr;
  for (cmsghdr* part = CMSG_FIRSTHDR(&header); part != nullptr; part = CMSG_NXTHDR(&header, part)) {
    if (part->cmsg_level != SOL_SOCKET) continue;
    if (part->cmsg_type == SCM_TIMESTAMPNS) {
      timespec stamp{};
      std::memcpy(&stamp, CMSG_DATA(part), sizeof stamp);
      out.time_ns = static_cast<std::int64_t>(stamp.tv_sec) * 1'000'000'000 + stamp.tv_nsec;
    } else if (part->cmsg_type == SO_RXQ_OVFL) {
      std::memcpy(&out.dropped, CMSG_DATA(part), sizeof out.dropped);
      out.has_dropped = true;
    }
  }
  return out;
}

bool wait_readable(int descriptor, double timeout_s) noexcept {
  pollfd wanted{descriptor, POLLIN, 0};
  const double seconds = std::clamp(timeout_s, 0.0, 1e6);
  const timespec timeout{static_cast<time_t>(seconds),
                         static_cast<long>((seconds - std::floor(seconds)) * 1e9)};
  return ppoll(&wanted, descriptor < 0 ? 0 : 1, &timeout, nullptr) > 0;
}

}  // namespace servotwin
