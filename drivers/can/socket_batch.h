// Reads many datagrams of a socket with one system call, each with the kernel's receive stamp and
// the number of datagrams dropped before it. A part of the CAN buses. One thread; after
// construction it allocates nothing and throws nothing. Source: recvmmsg(2), socket(7), packet(7).
#pragma once

#include <sys/socket.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace servotwin {

class SocketBatch {
 public:
  static constexpr std::size_t kMaxDatagrams = 64;

  explicit SocketBatch(std::size_t bytes_each);

  /// Asks the kernel for stamps and drop counts, and for a receive buffer of this size.
  static void prepare(int socket, int receive_buffer_bytes) noexcept;

  /// Returns the number of datagrams received, at most `most`; -1 with errno.
  int receive(int socket, std::size_t most) noexcept;

  struct Datagram {
    const std::uint8_t* data = nullptr;
    std::size_t size = 0;
    std::int64_t time_ns = 0;   ///< 0: the kernel gave no stamp
    std::uint32_t dropped = 0;  ///< by this socket so far, if has_dropped
    bool has_dropped = false;
    const sockaddr_storage* from = nullptr;
  };
  [[nodiscard]] Datagram operator[](std::size_t i) noexcept;

 private:
  static constexpr std::size_t kControl = 128;
  std::size_t bytes_each_;
  std::vector<std::uint8_t> data_;
  std::vector<sockaddr_storage> from_;
  std::array<mmsghdr, kMaxDatagrams> headers_{};
  std::array<iovec, kMaxDatagrams> vectors_{};
  alignas(cmsghdr) std::array<std::array<std::uint8_t, kControl>, kMaxDatagrams> control_{};
};

/// Waits until there is something to read; false if there is nothing after `timeout_s`.
bool wait_readable(int descriptor, double timeout_s) noexcept;

}  // namespace servotwin
