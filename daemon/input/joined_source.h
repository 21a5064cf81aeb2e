// Two sources as one machine: commands by DDS and encoders by CAN, or the other way round, or some
// axes by each, joined by frame_join.h.
//
// The second source is received by a thread of its own, which the first receive() starts: it has
// the priority and the processors of that thread. Else as frame_source.h. Offsets and predictions
// for a PLC are not sent on the buses of the two sources.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "daemon/between/ring.h"
#include "daemon/input/frame_join.h"
#include "daemon/input/frame_source.h"

namespace servotwin::daemon {

class JoinedSource final : public FrameSource {
 public:
  struct Part {
    std::unique_ptr<FrameSource> source;
    std::string name;  ///< "dds", for messages
  };
  /// Errors: as FrameJoin.
  JoinedSource(std::array<Part, 2> parts, std::vector<JoinedAxis> axes,
               std::array<double, 2> cycles_s);

  Received receive(MachineFrame& frame, double timeout_s) noexcept override;
  [[nodiscard]] std::int64_t age_ns() const noexcept override;
  [[nodiscard]] SourceState state(std::int64_t now_ns) const override;
  [[nodiscard]] std::vector<SourceNews> news(std::int64_t now_ns) override;

 private:
  void follow(const std::stop_token& stop) noexcept;
  void read_clocks() noexcept;
  void publish_clocks() noexcept;
  void tell_absent(std::uint64_t absent, std::int64_t now_ns, std::vector<SourceNews>& lines);

  std::array<Part, 2> parts_;
  FrameJoin join_;
  double look_s_;
  MachineFrame first_;
  bool ended_ = false;  // the first source

  static constexpr std::size_t kRoom = 64;
  Ring<FrameJoin::Sample> arrived_{kRoom};

  // For state(), each for itself: figures for people.
  std::atomic<bool> settled_{false};
  std::array<std::atomic<bool>, 2> known_{};
  std::atomic<double> ahead_s_{0.0}, drift_{0.0};
  std::atomic<std::uint64_t> absent_{0}, present_{0}, malformed_{0};
  // Of news().
  bool reported_settled_ = false, reported_unknown_ = false;
  std::int64_t unknown_since_ns_ = 0;  // 0: they are known, or no frames come
  std::uint64_t reported_absent_ = 0, seen_absent_ = 0, seen_present_ = 0;
  bool reported_gone_ = false;
  std::int64_t absent_since_ns_ = 0;  // 0: the last news() saw some of its samples
  std::int64_t reported_ns_ = 0;

  std::jthread follower_;  // last: joined before the rest goes
};

}  // namespace servotwin::daemon
