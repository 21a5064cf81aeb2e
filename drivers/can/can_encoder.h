// Encodes values of axes into the frames of a mapping.
// Bits that belong to no signal of the mapping are 0. Allocates nothing and throws nothing after
// its construction; one thread. Source: drivers/can/can_map.h.
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/can/can_frame.h"
#include "drivers/can/can_map.h"

namespace servotwin {

class CanEncoder {
 public:
  /// `map` must outlive the encoder.
  explicit CanEncoder(const CanMap& map);

  /// Writes a value [m | rad, or the unit of the channel] into its frame. Returns false and changes
  /// nothing if the mapping has no such signal or the value does not fit into its bits.
  bool set(std::size_t axis, CanChannel channel, double value) noexcept;
  /// The frame of CanMap::messages[message] with the values set so far.
  [[nodiscard]] const CanFrame& frame(std::size_t message) const noexcept {
    return frames_[message];
  }
  /// The frame that begins a cycle if it is not one of the messages (a SYNC).
  [[nodiscard]] CanFrame start() const noexcept;

  /// Whether a message carries this channel of any axis.
  [[nodiscard]] bool carries(std::size_t message, CanChannel channel) const noexcept;
  [[nodiscard]] const CanMap& map() const noexcept { return map_; }

 private:
  const CanMap& map_;
  std::vector<CanFrame> frames_;
};

}  // namespace servotwin
