// A CAN bus over UDP in cannelloni's format, for hosts without a CAN interface.
// Time stamps are those of the kernel for the packet: frames in one packet share a stamp, so cycles
// are counted (Pacing::kByCount), and lost packets are detected by their sequence numbers. Source:
// drivers/can/cannelloni.h. Threads: CanBus.
#pragma once

#include <sys/socket.h>

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "drivers/can/can_bus.h"
#include "drivers/can/cannelloni.h"
#include "drivers/can/socket_batch.h"

namespace servotwin {

struct CanUdpPlace {
  std::string listen = "127.0.0.1:20000";  ///< local ADDRESS:PORT; port 0: any free port
  /// HOST:PORT; empty: frames of any sender are accepted, on a loopback address only, and none is
  /// sent.
  std::string peer;
};

class CanUdp final : public CanBus {
 public:
  /// Throws std::runtime_error if `place` is not an address. `ours`: a local address to listen on.
  static void require_address(const std::string& place, bool ours) { (void)resolved(place, ours); }
  /// Throws std::runtime_error if other hosts could send frames because no peer is given.
  static void require_known_sender(const CanUdpPlace& place);
  /// Throws std::runtime_error with the address and what is wrong with it.
  explicit CanUdp(const CanUdpPlace& place);
  ~CanUdp() override;

  std::size_t receive(std::span<CanFrame> batch, double timeout_s) noexcept override;
  std::size_t send(std::span<const CanFrame> frames) noexcept override;
  [[nodiscard]] int descriptor() const noexcept override { return socket_; }
  /// The port that it listens on.
  [[nodiscard]] int port() const noexcept;

 private:
  // cannelloni's own packets fill an Ethernet frame; nothing larger is taken.
  static constexpr std::size_t kPacketBytes = 9000;
  struct Address {
    sockaddr_storage storage{};
    socklen_t size = 0;
  };
  [[nodiscard]] static Address resolved(const std::string& place, bool ours);
  [[nodiscard]] bool is_peer(const sockaddr_storage& from) const noexcept;
  /// The next packet of the batch, if it is one.
  bool open_packet() noexcept;

  int socket_ = -1;
  Address peer_;
  bool has_peer_ = false;
  SocketBatch batch_;
  std::size_t next_ = 0, came_ = 0;  // in batch_
  std::optional<CannelloniPacket> packet_;
  std::int64_t packet_ns_ = 0;
  std::optional<std::uint8_t> last_sequence_;
  std::uint32_t dropped_ = 0;
  bool after_gap_ = false;
  std::uint8_t sequence_ = 0;  // of what is sent
  std::array<std::uint8_t, 1400> out_{};
};

}  // namespace servotwin
