// The way back: values of axes into the frames of a mapping.
//
// Bits that no signal of the mapping has are 0. Allocates nothing and throws nothing after its
// construction; one thread. Source: drivers/can_map.h.
#pragma once

#include <cstdint>
#include <vector>

#include "drivers/can_frame.h"
#include "drivers/can_map.h"

namespace servotwin {

class CanEncoder {
 public:
  /// The map outlives it.
  explicit CanEncoder(const CanMap& map);

  /// Puts a value [m | rad, or of its unit] into its frame; false, and nothing changed, if the
  /// mapping has no such signal or its bits cannot carry the value.
  bool set(std::size_t axis, CanChannel channel, double value) noexcept;
  /// The frame of CanMap::messages[message], as it was set so far.
  [[nodiscard]] const CanFrame& frame(std::size_t message) const noexcept {
    return frames_[message];
  }
  /// The frame that begins a cycle, where it is none of the messages (a SYNC).
  [[nodiscard]] CanFrame start() const noexcept;

  /// Whether a message carries this channel of any axis.
  [[nodiscard]] bool carries(std::size_t message, CanChannel channel) const noexcept;
  [[nodiscard]] const CanMap& map() const noexcept { return map_; }

 private:
  const CanMap& map_;
  std::vector<CanFrame> frames_;
};

}  // namespace servotwin
