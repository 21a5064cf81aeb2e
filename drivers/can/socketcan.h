// A CAN interface of this host (Linux SocketCAN), classic and FD, with the kernel's receive stamps.
// An interface that goes down or disappears is counted; frames are received again when it is back.
// Needs no right but to read the interface. Source: Documentation/networking/can.rst. Threads:
// CanBus.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "drivers/can/can_bus.h"
#include "drivers/can/socket_batch.h"

namespace servotwin {

struct CanFilterId {
  std::uint32_t id = 0;
  bool extended = false;
};

struct SocketCanOptions {
  /// Receives only these ids and error frames; empty: all.
  std::vector<CanFilterId> only;
  /// The kernel's default loses frames in a flood; this holds about ten seconds of a full bus.
  int receive_buffer_bytes = 8 << 20;
};

class SocketCan final : public CanBus {
 public:
  /// Throws std::runtime_error if there is no such interface, or no CAN in this kernel. An
  /// interface that is down is waited for.
  explicit SocketCan(std::string interface, SocketCanOptions options = {});
  ~SocketCan() override;

  std::size_t receive(std::span<CanFrame> batch, double timeout_s) noexcept override;
  std::size_t send(std::span<const CanFrame> frames) noexcept override;
  [[nodiscard]] int descriptor() const noexcept override { return socket_; }
  [[nodiscard]] const std::string& interface() const noexcept { return interface_; }

 private:
  /// 0, or the errno of the call that failed.
  int open() noexcept;
  void close() noexcept;
  [[nodiscard]] bool interface_is_up() const noexcept;
  void look_after() noexcept;
  void on_failure(int error) noexcept;

  std::string interface_;
  SocketCanOptions options_;
  int socket_ = -1;
  SocketBatch batch_;
  std::uint32_t dropped_ = 0;   // of this socket
  std::int64_t looked_ns_ = 0;  // when it was last seen whether the interface is there
};

/// The ids that a bus of a mapping needs, its cycle's start included.
struct CanMap;
[[nodiscard]] std::vector<CanFilterId> ids_of(const CanMap& map, std::size_t bus);

}  // namespace servotwin
