// The interface to a CAN bus, independent of its transport; implemented for SocketCAN and UDP.
//
// receive and send belong to one thread each, allocate nothing and throw nothing; errors are
// counted, and a bus that disappeared is opened again when it is back. counts(): any thread.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>

#include "drivers/can/can_frame.h"

namespace servotwin {

struct CanBusCounts {
  std::uint64_t received = 0;
  std::uint64_t dropped = 0;    ///< by the kernel, because they were not read in time
  std::uint64_t lost = 0;       ///< packets that were not received (UDP)
  std::uint64_t malformed = 0;  ///< packets that are damaged, late or not from the peer (UDP)
  std::uint64_t sent = 0;
  std::uint64_t not_sent = 0;
  std::uint64_t downs = 0;  ///< how often the interface went down or disappeared
  bool up = true;
};

class CanBus {
 public:
  CanBus() = default;
  CanBus(const CanBus&) = delete;
  CanBus& operator=(const CanBus&) = delete;
  virtual ~CanBus() = default;

  /// Waits for at most `timeout_s` for frames; returns how many it has put into `batch`.
  virtual std::size_t receive(std::span<CanFrame> batch, double timeout_s) noexcept = 0;
  /// Returns how many of the frames were handed over to the bus.
  virtual std::size_t send(std::span<const CanFrame> frames) noexcept = 0;
  /// The file descriptor for poll(2); -1 while the bus is not open.
  [[nodiscard]] virtual int descriptor() const noexcept = 0;

  [[nodiscard]] CanBusCounts counts() const noexcept;

 protected:
  // Numbers for people, written by one thread each: relaxed, they order nothing.
  struct Counters {
    std::atomic<std::uint64_t> received{0}, dropped{0}, lost{0}, malformed{0}, sent{0}, not_sent{0},
        downs{0};
    std::atomic<bool> up{true};
  };
  static void count(std::atomic<std::uint64_t>& counter, std::uint64_t by = 1) noexcept {
    counter.store(counter.load(std::memory_order_relaxed) + by, std::memory_order_relaxed);
  }
  Counters counters_;
};

}  // namespace servotwin
